// Menu of the display settings. It opens below its button in the toolbar.

import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import { BACKGROUNDS, type Background, options, type SwitchName } from "../options";
import { PointSizeFields } from "../tools/pointsize";
import { LightFields } from "../tools/viewlight";
import type { Viewer } from "../viewer";
import { Button, Check, Field } from "../widgets/controls";
import { SideViewFields } from "./sideviews";

/** Width of the menu with its margin, as in style.css, pixels. */
const MENU_WIDTH = 246;

function Switch({ name, text, title }: { name: SwitchName; text: string; title?: string }) {
  const option = options[name];
  return <Check text={text} title={title} checked={option.shown.value === "on"} onChange={(on) => option.choose(on ? "on" : "off")} />;
}

function Group({ title, children }: { title: string; children: ComponentChildren }) {
  return (
    <fieldset>
      <legend>{title}</legend>
      {children}
    </fieldset>
  );
}

export function DisplayMenu({ viewer }: { viewer: Viewer }) {
  const menu = useRef<HTMLDivElement>(null);
  const button = useRef<HTMLButtonElement>(null);
  const { background, theme } = options;
  const place = () => {
    const { left, bottom } = button.current!.getBoundingClientRect();
    menu.current!.style.top = `${bottom + 6}px`;
    menu.current!.style.left = `${Math.max(6, Math.min(left, innerWidth - MENU_WIDTH))}px`;
  };
  const about = { title: "Grid, axes, light, shadows, point size, background, theme", popovertarget: "display" };
  const backgrounds = Object.entries(BACKGROUNDS) as [Background, string][];
  return (
    <>
      <Button icon="display" ref={button} aria-label="Display" aria-haspopup="dialog" {...about}>
        <span class="label">Display</span>
      </Button>
      <div ref={menu} class="menu" id="display" popover="auto" role="group" aria-label="Display" onBeforeToggle={place}>
        <Group title="Show">
          <Switch name="grid" text="Grid on the ground" />
          <Switch name="axes" text="Axes of the world" title="x red, y green, z blue" />
          <Switch name="wireframe" text="Wireframe" />
          <Switch name="orthographic" text="Orthographic" title="Parallel lines stay parallel" />
        </Group>
        <Group title="Beside the view">
          <SideViewFields viewer={viewer} />
        </Group>
        <Group title="Light">
          <Switch name="shadows" text="Shadows" title="Of the key light" />
          <Switch name="occlusion" text="Ambient occlusion" title="Darkens corners and contacts; costs the most" />
          <LightFields light={viewer.viewLight} />
        </Group>
        <Group title="Points">
          <PointSizeFields materials={viewer.stage.materials} />
        </Group>
        <Group title="Page">
          <Field label="Background" value={background.shown.value} choices={backgrounds} onChange={(name) => background.choose(name)} />
          <Check text="Dark theme" checked={theme.shown.value === "dark"} onChange={(on) => theme.choose(on ? "dark" : "light")} />
          <Switch name="shortcuts" text="Single-key shortcuts" title="Letters, digits, + and −" />
          <Button icon="panel" class="plain" title="All keys and mouse actions (?)" popovertarget="keys">
            Keys and mouse
          </Button>
        </Group>
      </div>
    </>
  );
}

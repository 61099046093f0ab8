// Buttons, links and form controls of the page.

import { useSignal } from "@preact/signals";
import type { ButtonHTMLAttributes, ComponentChildren, RefObject, TargetedEvent } from "preact";
import { useEffect } from "preact/hooks";
import { download } from "../files";
import type { TreeNode } from "../model";
import { Icon, type IconName } from "./icons";

interface ButtonProps extends ButtonHTMLAttributes {
  icon: IconName;
  /** Tooltip, and the label of a button without text. */
  title: string;
  pressed?: boolean;
}

export function Button({ icon, title, pressed, children, ...more }: ButtonProps) {
  return (
    <button type="button" title={title} aria-label={children ? undefined : title} aria-pressed={pressed} {...more}>
      <Icon name={icon} />
      {children}
    </button>
  );
}

/** Button that copies a text, or selects the element that shows it: browsers allow copies over HTTPS and on localhost. */
export function CopyButton({ text, shown, title }: { text: string; shown: RefObject<Element | null>; title: string }) {
  const label = useSignal("Copy");
  useEffect(() => void (label.value = "Copy"), [text]);
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(text);
      label.value = "Copied";
    } catch {
      getSelection()?.selectAllChildren(shown.current as Node);
      label.value = "Selected: press Ctrl+C";
    }
  };
  return (
    <Button icon="copy" class="plain" title={title} onClick={copy}>
      {label}
    </Button>
  );
}

type LinkProps = { icon: IconName; url: () => string; title: string; download: string; children?: ComponentChildren };

/** Link to a file whose URL is known when it is clicked. */
export function Download({ icon, url, children, ...more }: LinkProps) {
  const save = (event: MouseEvent) => {
    event.preventDefault();
    void download(url(), more.download);
  };
  return (
    <a class="button" href="./" onClick={save} {...more}>
      <Icon name={icon} />
      {children}
    </a>
  );
}

/** Slider for the opacity of a node on this page. */
export function Opacity({ node, label, changed }: { node: TreeNode; label: string; changed: (node: TreeNode) => void }) {
  const onInput = ({ currentTarget }: TargetedEvent<HTMLInputElement>) => {
    node.ownOpacity = Number(currentTarget.value);
    changed(node);
  };
  return <input type="range" min={0} max={1} step={0.05} aria-label={label} value={node.shownOpacity} onInput={onInput} />;
}

/** `label`: name for assistive programs; without it, an element `label` has the `id`. `choices`: values and their texts. */
type SelectProps<T extends string> = { label?: string; id?: string; value: T; choices: [T, string][]; onChange: (value: T) => void };

/** True if the menu that was used last was opened with the pointer; false: with a key. */
let usesPointer = false;

export function Select<T extends string>({ label, id, value, choices, onChange }: SelectProps<T>) {
  const change = ({ currentTarget: menu }: { currentTarget: HTMLSelectElement }) => {
    onChange(menu.value as T);
    if (usesPointer) menu.blur(); // keys are shortcuts again
  };
  const use = ({ type }: Event) => (usesPointer = type === "pointerdown");
  return (
    <select id={id} aria-label={label} value={value} onChange={change} onPointerDown={use} onKeyDown={use}>
      {choices.map(([each, text]) => (
        <option key={each} value={each}>
          {text}
        </option>
      ))}
    </select>
  );
}

/** Menu with its text before it. */
export function Field<T extends string>(menu: SelectProps<T> & { label: string; hidden?: boolean }) {
  return (
    <label class="field" hidden={menu.hidden}>
      {menu.label}
      <Select {...menu} />
    </label>
  );
}

type CheckProps = { text: string; title?: string; class?: string; checked: boolean; onChange: (on: boolean) => void };

/** Check box with its text after it. */
export function Check({ text, title, class: name = "check", checked, onChange }: CheckProps) {
  return (
    <label class={name} title={title}>
      <input type="checkbox" checked={checked} onChange={({ currentTarget }) => onChange(currentTarget.checked)} />
      {text}
    </label>
  );
}

/** Bar over the view. */
export function Pill({ label, icon, children }: { label: string; icon: IconName; children: ComponentChildren }) {
  return (
    <div class="pill" role="group" aria-label={label}>
      <Icon name={icon} />
      {children}
    </div>
  );
}

type TabListProps<T extends string> = { names: T[]; current: T; controls: (name: T) => string; onSelect: (name: T) => void };

/** Row of tabs; arrow keys move between them. `controls` returns the id of the element that a tab controls. */
export function TabList<T extends string>({ names, current, controls, onSelect }: TabListProps<T>) {
  const onKeyDown = (event: KeyboardEvent) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const next = (names.indexOf(current) + step + names.length) % names.length;
    onSelect(names[next]!);
    ((event.currentTarget as HTMLElement).children[next] as HTMLElement).focus();
    event.preventDefault();
  };
  return (
    <div class="tabs" role="tablist" onKeyDown={onKeyDown}>
      {names.map((name) => (
        <button
          key={name}
          type="button"
          role="tab"
          aria-controls={controls(name)}
          aria-selected={name === current}
          tabIndex={name === current ? 0 : -1}
          onClick={() => onSelect(name)}
        >
          {name}
        </button>
      ))}
    </div>
  );
}

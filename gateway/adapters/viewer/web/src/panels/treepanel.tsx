// The tree of paths: expand, search, hide, select. Only visible rows are elements, so thousands of nodes are fast.

import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useReducer, useRef } from "preact/hooks";
import { counted, pathText } from "../format";
import type { TreeNode } from "../model";
import type { Viewer } from "../viewer";
import { Button, Opacity } from "../widgets/controls";
import { Icon } from "../widgets/icons";
import { findTyped, listRows, type Row } from "./treerows";

/** Height of a row, CSS pixels: a finger needs more than a pointer. */
const ROW = matchMedia("(pointer: coarse)").matches ? 40 : 26;
const OPEN_AT_FIRST = 2;
/** Time after which a character starts a new search for a name. */
const TYPING_MS = 700;
/** Node below which Drake's families are. */
const DRAKE = "drake";

function Eye({ node, label, viewer }: { node: TreeNode; label: string; viewer: Viewer }) {
  const verb = node.isShown ? "Hide" : "Show";
  const onClick = (event: Event) => {
    event.stopPropagation();
    node.shown = !node.isShown;
    viewer.changed(node);
  };
  return <Button icon={node.isShown ? "eye" : "hidden"} class="eye" tabIndex={-1} aria-label={`${verb} ${label}`} title={verb} onClick={onClick} />;
}

/** Visibility and opacity of what Drake publishes: illustration, proximity, inertia, contacts, point clouds, frames. */
function Families({ viewer }: { viewer: Viewer }) {
  const families = [...(viewer.session.model.find([DRAKE])?.children ?? [])];
  return (
    <section class="families" aria-label="Drake" hidden={families.length === 0}>
      <h3>Drake</h3>
      {families.map((node) => (
        <div key={node.id} class={node.isShown ? "family" : "family hidden"}>
          <Eye node={node} label={`all ${node.name}`} viewer={viewer} />
          <span class="name">{node.name}</span>
          <Opacity label={`Opacity of ${node.name}`} node={node} changed={viewer.changed} />
        </div>
      ))}
    </section>
  );
}

export function TreePanel({ viewer }: { viewer: Viewer }) {
  const { session } = viewer;
  const search = useSignal("");
  const toggled = useRef(new Map<number, boolean>()).current;
  /** Text that is being typed to find a name. After a click on a row, keys are those of the page's shortcuts. */
  const typed = useRef({ text: "", time: 0, isOn: false }).current;
  const list = useRef<HTMLDivElement>(null);
  const [, repaint] = useReducer<number, unknown>((count) => count + 1, 0);
  const { value: selected } = session.selected;
  const { value: revealed } = session.revealed;
  session.changes.value;
  useMemo(() => {
    for (let at = revealed?.parent; at; at = at.parent) toggled.set(at.id, true);
  }, [revealed]);
  const searching = search.value.trim() !== "";
  const isOpen = ({ node, depth }: Row) => searching || (toggled.get(node.id) ?? depth < OPEN_AT_FIRST);
  const rows = listRows(session.model, search.value, isOpen);
  const toggle = (row: Row) => {
    toggled.set(row.node.id, !isOpen(row));
    repaint(row);
  };
  const scrollTo = (index: number) => {
    const area = list.current;
    if (!area || index < 0) return;
    const top = index * ROW;
    if (top < area.scrollTop || top > area.scrollTop + area.clientHeight - ROW) area.scrollTop = top - area.clientHeight / 2;
  };
  useEffect(() => {
    const observer = new ResizeObserver(repaint);
    observer.observe(list.current as Element);
    return () => observer.disconnect();
  }, []);
  useEffect(() => scrollTo(rows.findIndex(({ node }) => node === revealed)), [revealed]);

  const index = rows.findIndex(({ node }) => node === selected);
  const go = (to: number) => {
    typed.isOn = true;
    const at = Math.min(Math.max(to, 0), rows.length - 1);
    if (rows[at]) viewer.select(rows[at].node);
    scrollTo(at);
  };
  const keys: Record<string, (row: Row, shift: boolean) => void> = {
    ArrowRight: (row) => row.node.children.size && (isOpen(row) ? go(index + 1) : toggle(row)),
    ArrowLeft: (row) => {
      if (row.node.children.size && isOpen(row) && !searching) toggle(row);
      else go(rows.findIndex(({ node }) => node === row.node.parent));
    },
    " ": ({ node }) => {
      node.shown = !node.isShown;
      viewer.changed(node);
    },
    Enter: ({ node }, shift) => (shift ? viewer.follow.cycle(node) : viewer.fit(node)),
  };
  const onKeyDown = (event: KeyboardEvent) => {
    const { key, timeStamp } = event;
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const row = rows[index];
    const to = { ArrowDown: index + 1, ArrowUp: index - 1, Home: 0, End: rows.length - 1 }[key];
    if (to !== undefined) go(to);
    else if (keys[key]) row && keys[key](row, event.shiftKey);
    else if (key.length === 1 && typed.isOn) {
      typed.text = (timeStamp - typed.time < TYPING_MS ? typed.text : "") + key.toLowerCase();
      typed.time = timeStamp;
      go(findTyped(rows, index, typed.text));
    } else return;
    event.preventDefault();
  };

  const { scrollTop, clientHeight } = list.current ?? { scrollTop: 0, clientHeight: 0 };
  const first = Math.max(0, Math.floor(scrollTop / ROW) - 4);
  const shown = rows.slice(first, first + Math.ceil(clientHeight / ROW) + 12);
  const line = (row: Row, index: number) => {
    const { node, depth } = row;
    const name = node.shownName;
    const kinds = counted(node.parts?.map((part) => part.kind) ?? []).join(", ");
    const isParent = node.children.size > 0;
    return (
      <div
        key={node.id}
        class={`row${node === selected ? " selected" : ""}${node.isShown ? "" : " hidden"}`}
        role="treeitem"
        id={`row-${node.id}`}
        aria-level={depth + 1}
        aria-posinset={row.position}
        aria-setsize={row.siblings}
        aria-selected={node === selected}
        aria-expanded={isParent ? isOpen(row) : undefined}
        data-path={JSON.stringify(node.path)}
        style={`top: ${(first + index) * ROW}px; padding-left: ${6 + depth * 14}px`}
        onClick={() => viewer.select(node)}
        onDblClick={() => viewer.fit(node)}
      >
        <button
          type="button"
          class="arrow"
          tabIndex={-1}
          disabled={!isParent}
          aria-label={`${isOpen(row) ? "Collapse" : "Expand"} ${name}`}
          aria-expanded={isOpen(row)}
          onClick={(event) => {
            event.stopPropagation();
            toggle(row);
          }}
        >
          {isParent && <Icon name="chevron" />}
        </button>
        <span class={typeof node.name === "number" ? "name number" : "name"} title={pathText(node.path)}>
          {name}
        </span>
        <span class="kinds" title={kinds}>
          {kinds}
        </span>
        {viewer.follow.modeOf(node) && <Icon name="follow" title="The camera follows it" />}
        <Eye node={node} label={name} viewer={viewer} />
      </div>
    );
  };
  return (
    <section class="tree" aria-label="Scene tree" style={`--row: ${ROW}px`}>
      <header>
        <input
          type="search"
          placeholder="Search paths"
          aria-label="Search paths"
          onInput={({ currentTarget }) => (search.value = currentTarget.value)}
        />
      </header>
      <Families viewer={viewer} />
      <p class="empty" role="status" hidden={rows.length > 0}>
        No path contains “{search.value.trim()}”.
      </p>
      <div
        ref={list}
        class="rows"
        role="tree"
        tabIndex={0}
        aria-label="Paths"
        aria-activedescendant={selected ? `row-${selected.id}` : undefined}
        onScroll={repaint}
        onPointerDown={() => (typed.isOn = false)}
        onFocus={({ currentTarget }) => (typed.isOn = currentTarget.matches(":focus-visible"))}
        onKeyDown={onKeyDown}
      >
        <div class="spacer" style={`height: ${rows.length * ROW}px`} />
        {shown.map(line)}
      </div>
    </section>
  );
}

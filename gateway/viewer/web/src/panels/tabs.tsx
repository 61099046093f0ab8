// A row of tabs; arrow keys move between them.

interface TabListProps<T extends string> {
  names: readonly T[];
  current: T;
  /** Id of the element that a tab controls. */
  controls: (name: T) => string;
  onSelect: (name: T) => void;
}

export function TabList<T extends string>({ names, current, controls, onSelect }: TabListProps<T>) {
  const onKeyDown = (event: KeyboardEvent) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const next = (names.indexOf(current) + step + names.length) % names.length;
    onSelect(names[next] as T);
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

// Choices of this browser: from the URL (?shadows=on), else from an earlier visit, else the default.

const PREFIX = "scenegate.";

/** Return a choice; values that are not allowed are ignored. */
export function choice<T extends string>(name: string, allowed: readonly T[], otherwise: T): T {
  const values = [new URLSearchParams(location.search).get(name), stored(name)];
  for (const value of values) {
    const found = allowed.find((each) => each === value);
    if (found) return found;
  }
  return otherwise;
}

/** Keep a choice for the next visit. */
export function keep(name: string, value: string): void {
  try {
    localStorage.setItem(PREFIX + name, value);
  } catch {
    // Storage is off in this browser: the choice lasts as long as the page.
  }
}

function stored(name: string): string | null {
  try {
    return localStorage.getItem(PREFIX + name);
  } catch {
    return null;
  }
}

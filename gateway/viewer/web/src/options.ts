// Display settings of this browser, from the URL (?shadows=on), an earlier visit, or the default, in this order.

const PREFIX = "scenegate.";

/** Return a setting, or the default if no source has an allowed value. */
export function choice<T extends string>(name: string, allowed: readonly T[], fallback: T): T {
  const values = [new URLSearchParams(location.search).get(name), stored(name)];
  for (const value of values) {
    const found = allowed.find((each) => each === value);
    if (found) return found;
  }
  return fallback;
}

/** Store a setting for the next visit. */
export function keep(name: string, value: string): void {
  try {
    localStorage.setItem(PREFIX + name, value);
  } catch {
    // The browser does not allow storage: the setting lasts as long as the page.
  }
}

function stored(name: string): string | null {
  try {
    return localStorage.getItem(PREFIX + name);
  } catch {
    return null;
  }
}

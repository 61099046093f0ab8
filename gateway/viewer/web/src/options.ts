// Display settings of this browser, from the URL (?shadows=on), an earlier visit, or the default, in this order.

const PREFIX = "scenegate.";

/** Return a setting, or the default if no source has an allowed value. */
export function choice<T extends string>(name: string, allowed: readonly T[], fallback: T): T {
  const values = [new URLSearchParams(location.search).get(name), kept(name)];
  for (const value of values) {
    const found = allowed.find((each) => each === value);
    if (found) return found;
  }
  return fallback;
}

/** Return true if a setting is on. */
export function isOn(name: string, fallback: boolean): boolean {
  return choice(name, ["off", "on"], fallback ? "on" : "off") === "on";
}

/** Store a setting for the next visit. */
export function keep(name: string, value: string): void {
  try {
    localStorage.setItem(PREFIX + name, value);
  } catch {
    // The browser does not allow storage: the setting lasts as long as the page.
  }
}

/** Store a value until the tab is closed. */
export function keepInTab(name: string, value: unknown): void {
  try {
    sessionStorage.setItem(PREFIX + name, JSON.stringify(value));
  } catch {
    // As in `keep`.
  }
}

/** Return a value of `keepInTab`, or null. */
export function keptInTab<T>(name: string): T | null {
  try {
    return JSON.parse(sessionStorage.getItem(PREFIX + name) ?? "null") as T | null;
  } catch {
    return null;
  }
}

/** Return a setting that was stored at an earlier visit. */
export function kept(name: string): string | null {
  try {
    return localStorage.getItem(PREFIX + name);
  } catch {
    return null;
  }
}

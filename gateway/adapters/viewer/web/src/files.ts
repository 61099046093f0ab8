// Saving of files by the browser: those of the gateway, and those that the page makes.

import { signal } from "@preact/signals";

/** Sentence about what the gateway has refused, for some seconds. */
export const refusal = signal("");
const REFUSAL_MS = 15_000;

function saveAs(href: string, fileName: string): void {
  Object.assign(document.createElement("a"), { href, download: fileName }).click();
}

export function saveBlob(blob: Blob, fileName: string): void {
  const url = URL.createObjectURL(blob);
  saveAs(url, fileName);
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

/** Download a file of the gateway. If that fails, its sentence is in `refusal`. */
export async function download(url: string, fileName: string): Promise<void> {
  if (/^(data|blob):/.test(url)) return saveAs(url, fileName);
  const response = await fetch(url).catch(() => null);
  if (response?.ok) return saveBlob(await response.blob(), fileName);
  await refuse(fileName, response);
}

/** Say why something has failed: in the response's sentence; null: there was none. */
export async function refuse(what: string, response: Response | null): Promise<void> {
  const text = (await response?.text().catch(() => "")) ?? "";
  const { detail, message } = text.startsWith("{") ? JSON.parse(text) : { detail: text };
  say(`${what}: ${response ? detail || message || response.statusText : "the gateway does not respond"}`);
}

/** Show a sentence for some seconds. */
export function say(sentence: string): void {
  refusal.value = sentence;
  setTimeout(() => (refusal.value = ""), REFUSAL_MS);
}

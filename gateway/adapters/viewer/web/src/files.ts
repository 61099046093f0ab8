// Saving of files by the browser: those of the gateway, and those that the page makes.

import { signal } from "@preact/signals";

/** Sentence about a download that failed, for some seconds. */
export const downloadProblem = signal("");
const PROBLEM_MS = 15_000;

function saveAs(href: string, fileName: string): void {
  Object.assign(document.createElement("a"), { href, download: fileName }).click();
}

export function saveBlob(blob: Blob, fileName: string): void {
  const url = URL.createObjectURL(blob);
  saveAs(url, fileName);
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

/** Download a file of the gateway. If that fails, its sentence is in `downloadProblem`. */
export async function download(url: string, fileName: string): Promise<void> {
  if (/^(data|blob):/.test(url)) return saveAs(url, fileName);
  const response = await fetch(url).catch(() => null);
  if (response?.ok) return saveBlob(await response.blob(), fileName);
  const text = (await response?.text().catch(() => "")) ?? "";
  const sentence = text.startsWith("{") ? JSON.parse(text).detail : text;
  downloadProblem.value = `${fileName}: ${response ? sentence || response.statusText : "the gateway does not respond"}`;
  setTimeout(() => (downloadProblem.value = ""), PROBLEM_MS);
}

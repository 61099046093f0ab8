// What the page downloads of its gateway: textures and channels of point clouds. In a file with a recording they come from it.

const recorded = new Map<string, string>();

/** True if this page is a file with a recording: there is no gateway. */
export const isRecorded = (): boolean => typeof document !== "undefined" && document.getElementById("recording") !== null;

/** Return the address of a resource: that of the gateway, or that of its copy in the recording. */
export const addressOf = (path: string): string => recorded.get(path) ?? path;

export const imagePath = (id: number): string => `view/image/${id}`;
export const channelPath = (mesh: number, name: string): string => `view/channel/${mesh}?name=${encodeURIComponent(name)}`;

/** Keep the copy of a resource of a recording. */
export function keepResource(path: string, data: Uint8Array<ArrayBuffer>): void {
  recorded.set(path, URL.createObjectURL(new Blob([data])));
}

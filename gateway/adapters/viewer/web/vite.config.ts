import { defineConfig } from "vite";

export default defineConfig({
  // The page is /view, perhaps below a path prefix that only a proxy knows: all of its addresses are relative to it.
  experimental: {
    renderBuiltUrl: (file, { hostType }) => (hostType === "html" ? `view/${file}` : { relative: true }),
  },
  build: {
    outDir: "../static",
    emptyOutDir: true,
    chunkSizeWarningLimit: 1000,
    // three's licence comment does not survive the minifier; it ships as a file instead.
    license: { fileName: "THIRD_PARTY_LICENSES.md" },
  },
  server: {
    proxy: {
      "/view/ws": { target: "ws://127.0.0.1:8000", ws: true, headers: { origin: "http://127.0.0.1:8000" } },
      "/view/image": "http://127.0.0.1:8000",
      "/api": "http://127.0.0.1:8000",
      "/scene": "http://127.0.0.1:8000",
      "/cameras": "http://127.0.0.1:8000",
      "/stereo": "http://127.0.0.1:8000",
    },
  },
});

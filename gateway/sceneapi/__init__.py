"""The live scene over HTTP: what is in it, as a file, and as pictures from any camera."""

"""The scene's page in the browser: its view settings, and clicks and controls for the clients that want them."""

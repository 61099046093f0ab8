"""Drake's glTF render endpoint: a form with a scene and a camera in, an image out."""

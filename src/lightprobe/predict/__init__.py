"""One photo, camera and mask in, an environment map with a confidence for every direction out."""

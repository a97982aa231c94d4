"""A folder of photos in, a `Scene` out: cameras, masks, splits and the similarity to the normalised frame."""

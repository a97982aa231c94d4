"""Mesh, material, camera and light in, G-buffer and linear image out, with gradients or as a linear operator of the light."""

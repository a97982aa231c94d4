"""Mesh, material, camera and light in, G-buffer and linear image out; also as a linear operator of the light."""

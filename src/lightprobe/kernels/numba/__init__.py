"""Numba backend for float32 tensors on the CPU; the public modules above have checked the tensors."""

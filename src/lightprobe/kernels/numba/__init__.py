"""Numba bodies for float32 tensors on the CPU. Tensors in, tensors out, validated by the public modules
above.
"""

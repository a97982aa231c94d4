"""Triton backend for float32 tensors on a GPU. Tensors in, tensors out, validated by the public modules above.

Every sum has a fixed order, or is a sum of integers, which has none: the same call on the same device gives
the same bits. Without a GPU the tests run these kernels through Triton's interpreter (TRITON_INTERPRET=1).
"""

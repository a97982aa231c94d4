"""The few hot loops. Tensors in, tensors out; each op has a plain reference and a fast body under one signature."""

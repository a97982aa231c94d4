"""Plain PyTorch: the truth the tests compare with, and the fallback for float64 and for other devices."""

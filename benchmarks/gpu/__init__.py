"""What a GPU makes of the program: its tests, kernels, trainings and predictions, each part in a process of
its own.
"""

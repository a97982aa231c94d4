"""Runs as a library: a folder of photos in, a run folder out, and what is done with a run from then on.

run = training.train_run("photos/cup", "runs/cup", preset=Preset.QUICK)
evaluation.evaluate_run(run.path)
"""

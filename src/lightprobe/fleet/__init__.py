"""Many objects and many photos on many machines: trainings and predictions as tasks of a Ray cluster.

    SCENES, JOBS.parquet -> tasks -> Ray (this machine, or a cluster) -> runs, maps -> a Parquet index of all of them

Scenes, photos, runs and maps are folders of this machine, of a file system that all machines share, or of an object
store (`storage`). What a task is stands in `training_task` and `prediction_task`, which know nothing of Ray; the
drivers `training` and `predicting` hand the tasks to an `executor`, of which `ray_cluster` is the real one.
"""

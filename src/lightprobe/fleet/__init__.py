"""Many objects and many photos on many machines: trainings and predictions as tasks of a Ray cluster.

    SCENES, PHOTOS.parquet -> tasks -> Ray (this machine, or a cluster) -> runs, maps -> a Parquet index of all of them

Scenes, photos, runs and maps are folders of this machine, of a file system that all machines share, or of an object
store (`storage`). `training` and `predicting` hand their tasks to an `executor`, of which `ray_cluster` is the real one;
what a task does knows nothing of Ray.
"""

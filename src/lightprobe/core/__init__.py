"""Errors, configuration, devices, atomic files and the run folder: what every other package stands on."""

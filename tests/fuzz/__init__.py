"""An attack on every reader of files with damaged and hostile ones: `make fuzz`, or `python -m tests.fuzz`."""

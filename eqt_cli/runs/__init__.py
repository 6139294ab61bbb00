"""From a study to its result: blocks of runs, executors, the cross-check and the writer."""

"""From a study to its result: parts, executors, the cross-check and the writer."""

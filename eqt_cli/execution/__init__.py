"""From a study to its result folder: runs are computed in parts, kept, checked and packed."""

"""Tools that draw figures: styles, layout, labels, curves and marks."""

"""What figures are drawn with: styles, layout, labels, curves and marks."""

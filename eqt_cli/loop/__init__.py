"""The closed loop: group, mechanics, reference, law and vehicle as one differential equation."""

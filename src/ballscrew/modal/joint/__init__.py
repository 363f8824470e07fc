"""All cells of a run solved as one: the axial mode along the whole axis."""

"""Joint estimator: one model of the axial mode along the axis, fitted to all cells of a run."""

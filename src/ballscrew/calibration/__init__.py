"""Which model is this axis? Runs at several loads become an axial model with its uncertainties."""

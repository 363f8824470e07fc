"""The paper's method: the axial natural frequency of each cell from the peak of its FRF."""

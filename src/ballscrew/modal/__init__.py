"""At what frequency does the axis ring?  Transients → averaged spectra → FRF, coherence → mode table."""

"""The test: the fixed cycle feature test (FCFT), its stops, motions, conditions and cells."""

"""The paper's two experiments, its figures and claims, and the demonstration, on the testbed."""

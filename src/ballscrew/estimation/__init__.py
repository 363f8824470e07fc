"""How much preload is left? A run and a model become a preload, its change and the likely causes."""

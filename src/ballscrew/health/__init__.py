"""How much preload is left?  Mode tables → preload and its history."""

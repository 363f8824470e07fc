"""How long will it last? From the history of an epoch, by the laws of wear, to the remaining life."""

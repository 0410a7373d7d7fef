"""Hand-written rules on parts: what geometry alone says about bodies that move together."""

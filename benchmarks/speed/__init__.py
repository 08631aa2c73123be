"""How fast it is: see ``__main__``."""

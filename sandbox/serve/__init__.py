"""A live scene in the browser, from a machine without a screen. Needs the extra ``web``."""

"""Pages of the manual that are made from the code. Run before Sphinx reads the pages.

Each module has `pages()`: name of a page to its text in MyST.
"""

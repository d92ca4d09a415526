"""The verbs of the package, once: the command line, Python programs and batches call the same."""

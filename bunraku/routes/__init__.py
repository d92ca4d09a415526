"""From a performance and a figure to a moving character: a function of named stages each."""

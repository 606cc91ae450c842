"""Pages that are fed while a run or a suite goes on, and the server that feeds them."""

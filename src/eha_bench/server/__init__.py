"""`eha-bench serve`: a folder of results as pages, while the nights go on; reads only."""

"""`python -m eha_bench` is `eha-bench`."""

from eha_bench.cli.main import main

main()

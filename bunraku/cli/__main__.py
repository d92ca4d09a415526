"""Let `python -m bunraku.cli` do what `bunraku` does."""

from bunraku.cli import main

main()

"""One module per subcommand of ``canroll``: ``add_parser(subparsers)`` and ``run(args) -> int``."""

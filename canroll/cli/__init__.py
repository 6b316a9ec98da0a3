"""One module per subcommand of ``canroll``, with ``run(args) -> int``; options in ``*_parsers``."""

"""The parser of a command: each option says what it needs, what it excludes, and where it applies.

A command is a list of :data:`Option`, one a line, as :func:`opt` and :func:`flag` make them. An
option is given where it is on the command line, whatever its value. Relations are declared where
the option is: ``opt("--ticks", int, "N", "…", needs=("bound",))``. A condition is the destination
of another option, ``"bound"``: that it is given; or ``"pace=lockstep"``: that it has this value.
"""

import argparse
from collections.abc import Callable, Collection, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any, NoReturn

from canroll.errors import CanrollError, UnknownNameError
from canroll.setup.choices import CHOICES

FROZEN = frozenset(name for name, choice in CHOICES.items() if choice.frozen_in_calibration)
RARE = frozenset(("trust", *(choice.name for choice in CHOICES.values() if choice.rare)))


class UsageError(CanrollError):
    """The command line could not be understood."""


@dataclass(frozen=True, slots=True)
class Relations:
    """What an option has to do with others.

    Attributes:
        needs: conditions of which one has to hold, or the option has no effect.
        why: what it belongs to, in words; by default the options of ``needs``.
        excludes: conditions that may not hold, and why.
        only: modes of the command in which it has an effect, see :func:`check_mode`; none: all.
        outside: what to say of it in another mode, after its name.
    """

    needs: tuple[str, ...] = ()
    why: str = ""
    excludes: Mapping[str, str] = field(default_factory=dict)
    only: tuple[str, ...] = ()
    outside: str = ""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line that refers to ``--help``.

    Options have one spelling, as command lines are read and written again. ``--help`` leaves out
    the rare ones, and after a command's action the options of other actions, and the epilog if that
    is about one of these, ``epilog_of``. ``asked``: options, by destination, that make the command
    do more, which it does where the command line asks for it. ``of_file``: those that a project
    file alone says. ``handler``: "module:function" that is called with what is parsed.
    """

    def __init__(self, handler: str = "", **options: Any) -> None:  # noqa: ANN401
        self.handler = handler
        self.relations: dict[str, Relations] = {}
        self.asked: tuple[str, ...] = ()
        self.of_file: tuple[str, ...] = ()
        self.epilog_of = ""
        self._given: set[str] = set()
        self._mode: tuple[str, ...] = ()
        super().__init__(**{**options, "allow_abbrev": False})
        self.add_argument("--help-all", action=_HelpAll, help="show the rare options too")
        self.add_argument("--trust", action="store_true", help="execute code that files name too")

    def take(self, description: str, *options: "Option") -> None:
        """Describe the command, and add its options in their order."""
        self.description = description or None
        for option in options:
            option(self)

    def add_argument(
        self,
        *names: Any,  # noqa: ANN401
        needs: Sequence[str] = (),
        why: str = "",
        excludes: Mapping[str, str] | None = None,
        only: Sequence[str] = (),
        outside: str = "",
        **options: Any,  # noqa: ANN401
    ) -> argparse.Action:
        """Add an option with its :class:`Relations`; the rest is that of argparse."""
        action = super().add_argument(*names, **options)
        relations = Relations(tuple(needs), why, excludes or {}, tuple(only), outside)
        if relations != Relations():
            self.relate(relations, action.dest)
        return action

    def relate(self, relations: Relations, *names: str) -> None:
        """Declare relations of options that are there, by their destinations."""
        for name in names:
            before = self.relations.get(name, Relations())
            self.relations[name] = Relations(
                relations.needs or before.needs,
                relations.why or before.why,
                {**before.excludes, **relations.excludes},
                relations.only or before.only,
                relations.outside or before.outside,
            )

    def read(
        self, words: Sequence[str], added: Sequence[str] = ()
    ) -> tuple[argparse.Namespace, list[str]]:
        """Return the parsed words and those that are unknown.

        The result has the destinations of the options that are given as ``given``, of those that a
        project file has not ``added`` as ``written``, and the parser as ``parser``.

        Raises:
            UsageError: a wrong option.
            CanrollError: an option has no effect with another one.
        """
        self._given.clear()
        namespace, unknown = self.parse_known_args([*added, *words])
        namespace.given, namespace.parser = frozenset(self._given), self
        of_file = {self._option_string_actions[w].dest for w in added if w in self.options}
        namespace.written = namespace.given - of_file
        if not unknown:
            self._check(namespace)
        return namespace, unknown

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:  # noqa: ANN401
        # argparse asks for the values of each option that it meets on the command line
        if action.option_strings:
            self._given.add(action.dest)
        elif action.choices is not None:
            self._mode = (f"{action.dest}=", *(f"{action.dest}={word}" for word in arg_strings))
        return super()._get_values(action, arg_strings)

    def _check(self, namespace: argparse.Namespace) -> None:
        """Refuse options without effect in this combination, and what only a file may say."""
        for name in (name for name in self.of_file if name in namespace.written):
            raise UsageError(
                f"{self.spelt(name)}: {self.prog} does not take it: write it into canroll.toml"
                f"{', or use a --calibration that has it' if name in FROZEN else ''}"
            )
        for name in self.relations:
            if name not in namespace.given:
                continue
            relations = self.relations[name]
            for condition, why in relations.excludes.items():
                if _holds(namespace, condition):
                    raise CanrollError(f"{self.spelt(name)}: {why}: omit it")
            if relations.needs and not any(_holds(namespace, each) for each in relations.needs):
                why = relations.why or " and ".join(map(self.spelt, relations.needs))
                raise CanrollError(f"{self.spelt(name)}: it belongs to {why}: add that, or omit it")

    def spelt(self, condition: str) -> str:
        """Return how an option is written, with its value if it has one: "--pace lockstep"."""
        name, _, value = condition.partition("=")
        strings = next((a.option_strings for a in self._actions if a.dest == name), ())
        option = next((text for text in strings if text.startswith("--")), f"--{name}")
        return f"{option} {value}".rstrip()

    def format_help(self) -> str:
        """Return the help without the rare options and those of another action."""
        rare = [each for each in self._actions if each.dest in RARE or self._of_another(each.dest)]
        texts, epilog = [action.help for action in rare], self.epilog
        for action in rare:
            action.help = argparse.SUPPRESS
        if self._of_another(self.epilog_of):
            self.epilog = None
        try:
            return super().format_help()
        finally:
            self.epilog = epilog
            for action, text in zip(rare, texts, strict=True):
                action.help = text

    def _of_another(self, name: str) -> bool:
        """Whether an option belongs to another action than the one on the command line."""
        needs = self.relations.get(name, Relations()).needs
        of_action = bool(self._mode) and all(need.startswith(self._mode[0]) for need in needs)
        return bool(needs) and of_action and not set(needs) & set(self._mode[1:])

    @property
    def options(self) -> Set[str]:
        """How the options are written."""
        return self._option_string_actions.keys()

    def open_to(self, words: Sequence[str]) -> Collection[str]:
        """Return the options that a file may add to a command line.

        What makes the command do more is added where that is asked for, and what needs something
        where one of that is on the command line.
        """
        written = {part for word in words for part in word.split("=")}

        def asked(conditions: Sequence[str]) -> bool:
            pairs = (each.partition("=") for each in conditions)
            return any((value or self.spelt(name)) in written for name, _, value in pairs)

        closed = {n for n, r in self.relations.items() if r.needs and not asked(r.needs)}
        closed.update(() if asked(self.asked) else self.asked)
        return self.options - {self.spelt(name) for name in closed}

    def _check_value(self, action: argparse.Action, value: object) -> None:
        """Refuse a name that is not among the choices, with the nearest that is."""
        if action.choices is not None and value not in action.choices:
            what = action.option_strings[-1] if action.option_strings else action.dest
            raise UnknownNameError(what, str(value), map(str, action.choices))

    def error(self, message: str) -> NoReturn:
        """Report the error in one line on stderr and exit with 2."""
        raise UsageError(f"{message} (see '{self.prog} --help')")


Option = Callable[[Parser], object]
"""Adds itself to a parser."""


def opt(
    names: str,
    kind: Any,  # noqa: ANN401
    metavar: str | None,
    help: str | None,
    default: Any = None,  # noqa: ANN401
    **more: Any,  # noqa: ANN401
) -> Option:
    """Return an option with a value, or an argument.

    Args:
        names: how it is written, several with spaces between.
        kind: what reads its text; a tuple: the words that it may be.
        metavar: what stands for the value in the help.
        help: of it; "%(default)s" stands for the default.
        default: value where it is not given.
        more: its :class:`Relations`, and further keywords of argparse.
    """
    read = {"choices": kind} if isinstance(kind, tuple) else {"type": None if kind is str else kind}
    named = {"metavar": metavar, "help": help, "default": default, **read, **more}
    return lambda parser: parser.add_argument(*names.split(), **named)


def flag(names: str, help: str, **more: Any) -> Option:  # noqa: ANN401
    """Return a switch."""
    more = {"action": "store_true", "help": help, **more}
    return lambda parser: parser.add_argument(*names.split(), **more)


def repeated(names: str, kind: Any, metavar: str, help: str, **more: Any) -> Option:  # noqa: ANN401
    """Return an option that may be given several times, whose values are a list."""
    return opt(names, kind, metavar, f"{help}; may be repeated", action="append", **more)


def related(*names: str, **relations: Any) -> Option:  # noqa: ANN401
    """Return what declares :class:`Relations` of options before it, by their destinations."""
    return lambda parser: parser.relate(Relations(**relations), *names)


class _HelpAll(argparse.Action):
    """Print the help with the rare options, and exit."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(argparse.ArgumentParser.format_help(parser))
        parser.exit()


def _holds(namespace: argparse.Namespace, condition: str) -> bool:
    name, _, value = condition.partition("=")
    return str(getattr(namespace, name, None)) == value if value else name in namespace.given


def check_mode(
    args: argparse.Namespace,
    mode: str,
    *,
    but: Collection[str] = (),
    why: str = "",
    **words: object,
) -> None:
    """Refuse options that have no effect in the mode of a command, but those of a project file.

    Args:
        args: of :meth:`Parser.read`.
        mode: the mode that applies.
        but: options that have an effect all the same.
        why: what to say of an option that says nothing itself.
        words: what "{name}" in the texts stands for.

    Raises:
        CanrollError: an option that is given does not apply in it.
    """
    for name, relations in args.parser.relations.items():
        applies = not relations.only or mode in relations.only or name in but
        if name in args.written and not applies:
            outside = (relations.outside or f": {why}: omit it").format(mode=mode, **words)
            raise CanrollError(f"{args.parser.spelt(name)}{outside}")


def refuse(args: argparse.Namespace, name: str, why: str) -> None:
    """Refuse an option that is found to have no effect, unless a project file has it.

    Raises:
        CanrollError: it is on the command line; ``name`` is its destination.
    """
    if name in args.written:
        raise CanrollError(f"{args.parser.spelt(name)}: {why}: omit it")

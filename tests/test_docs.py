"""What the pages show is what their commands print, and the build that sees to it works."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from canroll.cli import main as cli
from tools.warm import served

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
WRITTEN = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md")), *PAGES]
"""All pages, those too that show no output of commands."""


@pytest.fixture(scope="module")
def one_server():
    """The commands of all pages are forked from one process."""
    with served():
        yield


def build(*arguments):
    """Run the docs build; return its exit code and what it printed."""
    done = subprocess.run(
        [ROOT / "scripts" / "refresh-docs", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


@pytest.mark.slow
def test_readme_shows_what_its_commands_print(one_server):
    code, text = build("--check", "--quick", ROOT / "README.md")
    assert code == 0, text


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [p if p.name == "tutorial.md" else pytest.param(p, marks=pytest.mark.slow) for p in PAGES],
    ids=lambda p: p.name,
)
def test_page_shows_what_its_quick_commands_print(page, one_server):
    code, text = build("--check", "--quick", page)
    assert code == 0, text


@pytest.mark.drift
def test_what_no_test_reruns_was_made_by_these_sources():
    code, text = build("--list")
    assert code == 0, f"scripts/refresh-docs --stale makes anew:\n{text}"


@pytest.mark.drift
def test_readme_names_every_page():
    section = (ROOT / "README.md").read_text("utf-8").partition("\n## Documentation\n")[2]
    linked = set(re.findall(r"\]\(([^)#:]+\.md)\)", section.partition("\n## ")[0]))
    pages = [*WRITTEN, ROOT / "CHANGELOG.md", *(ROOT / "examples").glob("*/README.md")]
    assert linked == {str(page.relative_to(ROOT)) for page in pages} - {"README.md"}


def slug(heading):
    """Return the anchor that a heading gets."""
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


@pytest.mark.drift
@pytest.mark.parametrize("page", WRITTEN, ids=lambda p: p.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(((?!https?:)[^)\s]+)\)", page.read_text("utf-8")):
        name, _, anchor = target.partition("#")
        path = page.parent / name if name else page
        assert path.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.+)$", path.read_text("utf-8"), re.M)
            assert anchor in map(slug, headings), target


def shown(page):
    """Yield the arguments of each canroll command in a block that the build does not run."""
    blocks = re.findall(r"^```(.*?)\n(.*?)^```$", page.read_text("utf-8"), re.M | re.S)
    for block in (text for label, text in blocks if label in ("", "sh")):
        for line in block.replace("\\\n", " ").splitlines():
            if line.startswith("canroll "):
                yield shlex.split(re.split(r" && | \|", line)[0], comments=True)[1:]


@pytest.mark.parametrize("page", WRITTEN, ids=lambda p: p.name)
def test_commands_that_the_build_does_not_run_are_understood(page):
    for arguments in shown(page):
        cli.parse(arguments)


@pytest.mark.drift
@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_a_file_that_commands_take_is_named_in_the_text(page):
    text = page.read_text("utf-8")
    for block in re.finditer(r"^```\w+ (\S+\.\w+)\n.*?^```$", text, re.M | re.S):
        taken = re.findall(r"^```(?:console|sh).*?^```$", text[block.end() :], re.M | re.S)
        if any(re.search(rf"[ =]{re.escape(block[1])}\b", commands) for commands in taken):
            # viewers show a fence without its name
            assert block[1] in re.sub(r"^```\w+ \S+$", "", text[: block.start()], flags=re.M)


def test_there_are_such_commands():
    assert sum(len(list(shown(page))) for page in [ROOT / "README.md", *PAGES]) > 10


@pytest.fixture
def page(tmp_path):
    """Return a function that writes a page."""

    def write(text):
        path = tmp_path / "page.md"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_block_is_refreshed_and_then_up_to_date(page):
    path = page("before\n\n```console\n$ echo one\nnought\n$ echo two \\\n  three\n```\n\nafter\n")
    assert build("--check", path)[0] == 1
    assert build(path)[0] == 0
    assert path.read_text() == (
        "before\n\n```console\n$ echo one\none\n$ echo two \\\n  three\ntwo three\n```\n\nafter\n"
    )
    assert build("--check", path)[0] == 0


@pytest.mark.parametrize(
    ("printed", "code"),
    [
        ("a = [0.1234567890123, 4.77e-12]", 0),
        ("a = [0.1234567, 4.7e-12]", 1),
        ("a = [0.12345678901, 4.7e-3]", 1),
        ("b = [0.12345678901, 4.7e-12]", 1),
        ("a = [0.12345678901, 4.7e-12, 1.0]", 1),
    ],
)
def test_the_last_digits_of_another_processor_are_not_compared(page, printed, code):
    path = page(f"```console\n$ echo '{printed}'\na = [0.12345678901, 4.7e-12]\n```\n")
    assert build("--check", path)[0] == code
    before = path.read_text()
    assert build(path)[0] == 0
    assert (path.read_text() == before) == (code == 0)


def test_a_part_of_the_page_is_made_by_a_command(page):
    path = page("<!-- made by: printf '| a |\\n' -->\n<!-- end -->\n")
    assert build(path)[0] == 0
    assert path.read_text() == "<!-- made by: printf '| a |\\n' -->\n| a |\n<!-- end -->\n"


def test_a_failed_verdict_before_a_pipe_is_shown(page):
    path = page("```console\n$ (echo worse; exit 1) | cat\nworse\n$ yes | head -1\ny\n```\n")
    assert build("--check", path)[0] == 0


def test_the_progress_of_slow_machines_is_not_shown(page):
    path = page("```console\n$ echo draw 7 of 9 after 2 min; echo end\nend\n```\n")
    assert build("--check", path)[0] == 0


def test_files_of_the_page_are_there_for_its_commands(page):
    path = page("```toml own.toml\na = 1\n```\n\n```console\n$ cat own.toml\na = 1\n```\n")
    assert build("--check", path)[0] == 0


def test_what_is_slow_is_left_out_where_it_is_to_be_quick(page):
    path = page(
        "```console slow\n$ echo new\nold\n```\n\n"
        "<!-- slow, made by: echo new -->\nold\n<!-- end -->\n"
    )
    assert build("--check", "--quick", path)[0] == 0
    code, text = build("--check", path)
    assert code == 1 and text.count("out of date") == 2


def test_what_depends_on_the_machine_is_run_and_not_compared(page):
    path = page("```console machine\n$ echo new\nold\n```\n")
    assert build("--check", path)[0] == 0
    assert build(path)[0] == 0
    assert "\nnew\n" in path.read_text()


def test_a_picture_is_the_one_that_the_commands_leave(page):
    path = page("![it](it.png)<!-- from made.png -->\n\n```console\n$ echo it > made.png\n```\n")
    assert build("--check", path)[0] == 1
    assert build(path)[0] == 0
    assert path.with_name("it.png").read_text() == "it\n"
    assert build("--check", path)[0] == 0


def test_a_picture_that_no_command_leaves_fails_the_build(page):
    path = page("![it](it.png)<!-- from made.png -->\n\n```console\n$ echo it\nit\n```\n")
    code, text = build(path)
    assert code == 1 and "page.md: no command leaves made.png" in text


@pytest.mark.parametrize(
    "command", ["echo told; false", "(echo told; exit 3) | cat", "(echo told; exit 2) | cat | cat"]
)
def test_a_command_that_fails_fails_the_build(page, command):
    path = page(f"```console machine\n$ {command}\ntold\n```\n")
    code, text = build(path)
    assert code == 1 and re.search(r"page.md:1: exit code \d: told", text)

"""The checker of the prose: what it finds, and what it leaves alone."""

import pytest

from tests.prose import (
    PENDING,
    ROOT,
    browser_findings,
    code_findings,
    findings,
    modules,
    pages,
    paragraphs,
    plain,
    report,
    sentences,
)

PLAIN = "The control unit samples total demand and broadcasts a signal.\n"


def whats(page: str) -> list[str]:
    return [what for _, what in findings(page)]


def test_plain_text_has_no_findings() -> None:
    assert findings(PLAIN) == []


@pytest.mark.parametrize(("words", "found"), [(35, 0), (36, 1)])
def test_a_sentence_has_at_most_35_words(words: int, found: int) -> None:
    sentence = " ".join(["word"] * words) + "."
    page = sentence.replace("word word word word word ", "word word word word word\n")
    assert len(whats(page)) == found
    assert len(whats(f"| a | {sentence} |\n")) == found  # a cell is prose
    assert len(whats(f"- {page}")) == found


def test_sentences_end_at_full_stops_and_not_at_abbreviations() -> None:
    assert sentences("One, e.g. two. Three 0.5 four? Five") == ["One, e.g. two.", "Three 0.5 four?", "Five"]
    assert sentences("S. E. Alam wrote it. It (see X.) ends.") == [
        "S. E. Alam wrote it.",
        "It (see X.) ends.",
    ]


def test_code_formulas_and_links_are_words() -> None:
    text = "Say `a b c d` or $x + y + z$, see [the *page*](where.md#it) and {doc}`the API <api/index>`."
    assert plain(text) == "Say Code or Formula, see the *page* and Reference."
    long = " ".join(["word"] * 60)
    for page in (f"```python\n# {long}\n```\n", f"    {long}\n", f"`{long}`\n", f"<!-- {long} -->\n"):
        assert not [what for what in whats(page) if "sentence" in what], page


def test_text_after_a_block_is_prose_again() -> None:
    page = "````text\n```\nnobody\n````\n\nIt helps nobody.\n"
    assert findings(page) == [(6, "'nobody': name the agents, the users or the part")]


@pytest.mark.parametrize(
    "words", ["Whoever answers", "an agent who answers", "the same luck", "It looks at x"]
)
def test_banned_words_are_found_with_their_line(words: str) -> None:
    (found,) = findings(f"# Title\n\n{words}.\n")
    assert found.line == 3


def test_people_may_be_a_who_and_code_may_be_anything() -> None:
    assert findings("Some users who read `nobody looks` are people who count.\n") == []


def test_source_lines_have_at_most_120_characters() -> None:
    row = "".join(f"| {i} " for i in range(60)) + "|"
    assert whats(f"{row}\n") == []
    line = "It is. " * 18
    assert [what for what in whats(line) if "characters" in what] == ["126 characters, at most 120"]


@pytest.mark.parametrize(
    "caption", ["", "The total", "With latency demand is above the capacity", "How demand is"]
)
def test_captions_name_what_is_shown(caption: str) -> None:
    assert len(whats(f"![{caption}](images/a.png)\n")) == 1
    assert len(whats(f'<img src="images/a.png" alt="{caption}">\n')) == 1


def test_a_caption_with_a_subject_is_well() -> None:
    assert whats("![Total demand of memory over time: peaks are above the capacity](images/a.png)\n") == []


def test_paragraphs_are_items_cells_and_headings() -> None:
    page = "# A\nb\nc\n- d\n  e\n- f\n\n| g | h |\n"
    found = [(2, "b c"), (4, "- d e"), (6, "- f"), (8, "g"), (8, "h")]
    assert [tuple(one) for one in paragraphs(page)] == [(1, "A"), *found]


def test_pending_pages_are_free_and_must_need_it() -> None:
    contents = {"a.md": PLAIN, "b.md": "Nobody.\n"}
    assert report(contents, frozenset({"b.md"})) == []
    assert report(contents, frozenset({"a.md", "c.md"})) == [
        "c.md: is in PENDING and there is no such page",
        "a.md: fulfils the rules; take it out of PENDING",
        "b.md:1: 'Nobody': name the agents, the users or the part",
    ]


def test_banned_words_of_strings_are_found_with_their_line() -> None:
    source = '''"""First line.

    The rest is for nobody, unless
    given.
    """

who = looks = "looks"  # names are not read, comments are, whatever they say: looks are a term there
message = f"total {who} is read by somebody"
'''
    found = [(line, what.split(":")[0]) for line, what in code_findings(source)]
    assert found == [(3, "'nobody'"), (3, "'unless given'"), (7, "'whatever'"), (8, "'somebody'")]
    assert report({"a.py": source}, frozenset())[0].startswith("a.py:3: 'nobody': ")


def test_long_sentences_of_docstrings_are_found_with_their_line() -> None:
    long = "\n    ".join(["word " * 20] * 2)
    source = f'''def function(x: int) -> int:
    """Say.

    Parameters
    ----------
    x : int
        {long}.

    Short::

        {long}

    >>> {"word " * 40}

    .. math::

        {long}
    """
'''
    assert [tuple(one) for one in code_findings(source)] == [
        (7, "sentence of 40 words, at most 35: word word word word word word …")
    ]
    halves = source.replace(long, f"{'word ' * 20}\n    y : int\n        {'word ' * 20}", 1)
    assert code_findings(halves) == []  # the text of a parameter is one
    assert code_findings(f"message = {'word ' * 40!r}") == []


def test_code_in_strings_is_free() -> None:
    assert code_findings('"""Run with `looks` of ``who``.\n\nlooks : int\n    When.\n"""') == []


def test_pages_of_a_browser_are_read() -> None:
    html = '<p\ntitle="for nobody">An agent who\nanswers</p> <i class="who">x</i>'
    script = "const who = `the ${luck} of all`; // nobody\nsay('what everybody does', \"luck\")"
    assert [(found.line, found.what.split(":")[0]) for found in browser_findings(html)] == [
        (2, "'nobody'"),
        (2, "'who'"),
    ]
    assert report({"a.js": script}, frozenset()) == [
        "a.js:1: 'luck': say 'random error' or 'random numbers'",
        "a.js:2: 'everybody': name the agents, the users or the part",
    ]


def test_modules_of_all_packages_are_read() -> None:
    names = {path.relative_to(ROOT).as_posix() for path in modules()}
    assert {
        "aimd_des/engine/simulation.py",
        "models/tcp_flows.py",
        "scenarios/outage.py",
        "aimd_des/live/page/main.js",
    } <= names


def test_the_pages_are_there() -> None:
    names = {path.name for path in pages()}
    assert {"README.md", "CONTRIBUTING.md", "index.md", "model.md"} <= names
    assert {name.rsplit("/", 1)[-1] for name in PENDING} <= names

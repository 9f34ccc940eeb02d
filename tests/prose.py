"""Checks the prose of the pages and of the code, for `make lint`: `python -m tests.prose`.

The pages are those of `docs`, the README and CONTRIBUTING. The rules are few: short sentences, plain words,
short source lines, and captions that name what is shown. Code, output and formulas are not prose.
Docstrings, messages and comments of the code must use plain words, too; docstrings of classes and functions
must have short sentences.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]

# Pages that do not fulfil the rules yet. A page of this list that fulfils them is a finding: take it out.
PENDING = frozenset({"docs/theory_table.md"})

PACKAGES = ("aimd_des", "models", "scenarios", "examples", "benchmarks")

SENTENCE_WORDS = 35
LINE_CHARACTERS = 120
CAPTION_WORDS = 5

# Each pattern with the remedy. People may be a "who"; mechanisms are a "which" or a "that".
BANNED = {
    r"(?<!people )(?<!users )(?<!readers )(?<!authors )(?<!researchers )who": "name the part: 'that'",
    r"whoever|whatever|whichever": "say 'any', 'every' or name the thing",
    r"(?:some|every|any)body|nobody": "name the agents, the users or the part",
    r"luck|lucky|luckily": "say 'random error' or 'random numbers'",
    r"looks": "say 'samples', 'observes' or 'reads'",
    r"look(?:s|ed|ing)? on": "say 'observes' or 'records'",
    r"teeth|tooth": "say 'sawtooth' or 'period'",
    r"bits? helps? nobody|no bit helps": "say what the signal changes",
    r"what holds unless given|unless said|unless given": "say 'default'",
    r"at the door|in sight|stands? still|as it stands": "no metaphors",
    r"(?:proofs?|theory|results?|models?) (?:want|wants)": "say 'assumes' or 'requires'",
    r"nothing but|none but|all but": "say 'only' or 'all except'",
    r"be it|that is all": "leave it out",
    r"makes? good": "say 'compensate'",
    r"whither|thereof|wherever|whence|hence": "say 'where' or 'so'",
}
_BANNED = {re.compile(rf"\b(?:{pattern})\b", re.IGNORECASE): remedy for pattern, remedy in BANNED.items()}

# Text between tags, and strings.
_SHOWN = re.compile(
    r">(?P<text>[^<>{}]+)</|(?P<quote>[\"'`])(?P<string>(?:\\.|(?!(?P=quote))[^\n])+)(?P=quote)"
)

_PARAMETER = re.compile(r"^ *[\w*, ]+ : .*$", re.MULTILINE)
_UNDERLINE = re.compile(r" *[-=]{3}[-= ]*")
_BLOCK = re.compile(r"(?:[^\n]*\S[^\n]*\n?)+")

# First words of a caption without a subject: "How many", "With latency", "Seen from".
_NO_SUBJECT = re.compile(
    r"(?:as|at|in|on|with|when|where|what|how|seen|drawn|from|after|before)\b", re.IGNORECASE
)

_FENCE = re.compile(r"^ *(`{3,}|~{3,})")
_IMAGE = re.compile(r"!\[(?P<text>[^\]]*)\]\([^)]*\)")
_ALT = re.compile(r"<img\b[^>]*?\balt=\"(?P<text>[^\"]*)\"")
_STARTS_PARAGRAPH = re.compile(r" *(?:[-*+]|\d+\.) ")
_END = re.compile(r"(?<=[.!?])[\"'”)*]*\s+(?=[\"'“(*]*[A-Z0-9`])")
_ABBREVIATION = re.compile(r"\b(?:e\.g|i\.e|vs|cf|et al|[A-Z])\.$")
_PLAIN = (
    (re.compile(r"<!--.*?-->", re.DOTALL), " "),
    (re.compile(r"\$\$.*?\$\$", re.DOTALL), " Formula "),
    (re.compile(r"\{[a-z:]+\}`[^`]*`"), "Reference"),
    (re.compile(r"(`+)(?:(?!\1).)+?\1", re.DOTALL), "Code"),
    (re.compile(r"\$[^$\n]+\$"), "Formula"),
    (_IMAGE, " "),
    (re.compile(r"\[([^\]]*)\]\([^)]*\)"), r"\1"),
    (re.compile(r"<[^>\n]+>"), ""),
)


class Finding(NamedTuple):
    """What is wrong in a line of a page; lines count from 1."""

    line: int
    what: str


class Paragraph(NamedTuple):
    """Prose that belongs together, and its first line."""

    line: int
    text: str


def pages() -> list[Path]:
    """All pages that people read, but for the changelog."""
    docs = ROOT / "docs"
    made = {"_build", "_examples", "gallery"}
    found = [path for path in docs.rglob("*.md") if not made & set(path.relative_to(docs).parts)]
    return [*sorted(found), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]


def modules() -> list[Path]:
    """All modules of the packages, and all pages of a browser, whose words people read."""
    return sorted(
        path
        for package in PACKAGES
        for ends in ("py", "html", "js")
        for path in (ROOT / package).rglob(f"*.{ends}")
    )


def texts(source: str) -> Iterator[Paragraph]:
    """Paragraphs of the string constants of a module with more than one word, without names of parameters."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value if len(node.value.split()) > 1 else ""
            for block in _BLOCK.finditer(text):
                start = node.lineno + text.count("\n", 0, block.start())
                yield Paragraph(start, " ".join(_PARAMETER.sub("", block[0]).split()))


def _parts(docstring: str) -> Iterator[tuple[int, str]]:
    """Lines of prose with their numbers from 0; empty where they are titles, examples, blocks and tables."""
    block = example = table = False
    depth = 0
    lines = docstring.splitlines()
    for number, line in enumerate(lines):
        text, indent = line.strip(), len(line) - len(line.lstrip())
        title = _UNDERLINE.fullmatch("".join(lines[number + 1 : number + 2]))
        block = block and (not text or indent > depth)
        example = bool(text) and (example or text.startswith(">>>"))
        table = bool(text) and (table or text.startswith("===="))
        if block or example or table or title or _UNDERLINE.fullmatch(line) or _PARAMETER.fullmatch(line):
            yield number, ""
        elif text.startswith(".. ") or text.endswith("::"):
            block, depth = True, indent
            yield number, "" if text.startswith(".. ") else text
        else:
            yield number, line


def described(source: str) -> Iterator[Paragraph]:
    """Paragraphs of the docstrings of classes and functions: a text of a parameter is one."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and (docstring := ast.get_docstring(node)):
            first = node.body[0].lineno
            yield from _joined((first + number, text) for number, text in _parts(docstring))


def _prose(page: str) -> Iterator[tuple[int, str]]:
    """Lines outside code and directives with their numbers; inside them, empty lines."""
    fence = ""
    for number, line in enumerate(page.splitlines(), 1):
        mark = _FENCE.match(line)
        if mark and not fence:
            fence = mark[1]
        elif mark and mark[1].startswith(fence) and line.strip() == mark[1]:
            fence = ""
        else:
            yield number, "" if fence or line.startswith("    ") else line
            continue
        yield number, ""


def _joined(lines: Iterable[tuple[int, str]]) -> list[Paragraph]:
    """Join numbered lines into paragraphs, items of lists, and cells of tables."""
    found: list[Paragraph] = []
    begun: list[str] = []
    start = 0

    def end() -> None:
        if begun:
            found.append(Paragraph(start, " ".join(begun)))
            begun.clear()

    for number, line in lines:
        if line.startswith("|"):
            end()
            found += [Paragraph(number, cell.strip()) for cell in line.strip("|").split("|")]
        elif line.startswith("#"):
            end()
            found.append(Paragraph(number, line.lstrip("# ")))
        elif not line.strip():
            end()
        else:
            if _STARTS_PARAGRAPH.match(line):
                end()
            if not begun:
                start = number
            begun.append(line.strip())
    end()
    return found


def paragraphs(page: str) -> list[Paragraph]:
    """Prose of a page: paragraphs, items of lists, and cells of tables."""
    return _joined(_prose(page))


def plain(text: str) -> str:
    """The words of a paragraph: code, a formula and a reference are one word each."""
    for pattern, word in _PLAIN:
        text = pattern.sub(word, text)
    return text


def sentences(text: str) -> list[str]:
    """Sentences of plain text; a full stop behind an abbreviation or an initial ends none."""
    found: list[str] = []
    for part in _END.split(text):
        if found and _ABBREVIATION.search(found[-1]):
            found[-1] += f" {part}"
        else:
            found.append(part)
    return found


def _words(text: str) -> int:
    return sum(any(sign.isalnum() for sign in word) for word in text.split())


def _long_lines(page: str) -> Iterator[Finding]:
    """Source lines that are too long to read a change; rows of tables and unbroken links are exempt."""
    for number, line in enumerate(page.splitlines(), 1):
        exempt = line.startswith("|") or " " not in line.strip() or _IMAGE.fullmatch(line.strip())
        if len(line) > LINE_CHARACTERS and not exempt:
            yield Finding(number, f"{len(line)} characters, at most {LINE_CHARACTERS}")


def _captions(page: str) -> Iterator[Finding]:
    for pattern in (_IMAGE, _ALT):
        for match in pattern.finditer(page):
            text, number = match["text"], page.count("\n", 0, match.start()) + 1
            if _words(text) < CAPTION_WORDS or _NO_SUBJECT.match(text):
                yield Finding(number, f"caption {text!r}: name what is shown, then what to see in it")


def _banned(paragraph: Paragraph) -> Iterator[Finding]:
    words = plain(paragraph.text)
    for pattern, remedy in _BANNED.items():
        for match in pattern.finditer(words):
            yield Finding(paragraph.line, f"{match[0]!r}: {remedy}")


def browser_findings(source: str) -> list[Finding]:
    """Words that break the rules in strings of JavaScript, and in text and attributes of HTML."""
    found: list[Finding] = []
    for match in _SHOWN.finditer(source):
        number, text = source.count("\n", 0, match.start()) + 1, match["text"] or match["string"]
        found += _banned(Paragraph(number, text if len(text.split()) > 1 else ""))
    return found


def _comments(source: str) -> Iterator[Paragraph]:
    """Comments of a module, without those looks of a control unit that code is about."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield Paragraph(token.start[0], re.sub(r"\b[Ll]ooks\b", "samples", token.string))


def _long_sentences(paragraph: Paragraph) -> Iterator[Finding]:
    for sentence in sentences(plain(paragraph.text)):
        if (count := _words(sentence)) > SENTENCE_WORDS:
            begin = " ".join(sentence.split()[:6])
            what = f"sentence of {count} words, at most {SENTENCE_WORDS}: {begin} …"
            yield Finding(paragraph.line, what)


def code_findings(source: str) -> list[Finding]:
    """What breaks the rules in a module's strings and comments, with the first line of their paragraph."""
    words = [found for paragraph in (*texts(source), *_comments(source)) for found in _banned(paragraph)]
    return sorted(words + [found for paragraph in described(source) for found in _long_sentences(paragraph)])


def findings(page: str) -> list[Finding]:
    """Everything that breaks a rule, in the order of the lines."""
    found = [*_long_lines(page), *_captions(page)]
    for paragraph in paragraphs(page):
        found += [*_long_sentences(paragraph), *_banned(paragraph)]
    return sorted(found)


_FINDERS = {"py": code_findings, "html": browser_findings, "js": browser_findings, "md": findings}


def report(contents: dict[str, str], pending: frozenset[str]) -> list[str]:
    """One line for each finding in pages and modules; a page in `pending` is free, and must need it."""
    lines = [f"{name}: is in PENDING and there is no such page" for name in sorted(pending - set(contents))]
    for name, page in contents.items():
        found = _FINDERS[name.rpartition(".")[2]](page)
        if name not in pending:
            lines += [f"{name}:{line}: {what}" for line, what in found]
        elif not found:
            lines.append(f"{name}: fulfils the rules; take it out of PENDING")
    return lines


def main() -> int:
    """Print the findings; 1 where there are any."""
    paths = [*pages(), *modules()]
    named = {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}
    lines = report(named, PENDING)
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())

"""Check the prose of the manual: sentences, words and links; `make lint` runs it.

python scripts/check_prose.py            all pages
python scripts/check_prose.py PAGE ...   these pages
python scripts/check_prose.py --count    words outside code, and words per sentence, of every page
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
LONGEST = 30  # words a sentence
STARTS = ("What ", "Where ", "Of ")  # of questions only
ALLOWED = ("Of course",)
WORDS = {
    r"stand-in": "simulated crane",
    r"planted": "true value",
    r"spool commands?": "valve command",
    r"dead zones?": "dead band",
    r"hidden|(?:hide|hides|hiding) (an |the )?effects?": "injected, inject",
    r"labels?": "ground truth",
    r"gates?": "threshold",
    r"(?<!friction )(?<!control )laws?": "model form",
    r"gap": "model error",
    r"strengths?": "relative magnitude",
    r"race": "forward selection",
    r"twins?": "identified simulation, or indistinguishable effects",
    r"that lies?|lying": "faulty",
    r"settles?|settled": "discriminate",
    r"bows?": "nonlinearity",
    r"rooms?": "module, or clearance",
    r"(?<!one )(?<!half )(?<!both )ways?": "displacement, path",
    r"mend(s|ed|ing)?": "repair",
    r"foretells?|foretold": "predict",
    r"beside": "next to",
    r"held to": "applied to",
    r"alike": "the same",
    r"(Table|Tables) [12]\b": "joint limits, geometry",
    r"of one's own": "your",
    r"(?<!There )is no": "is not a",
}
"""Words of earlier pages, and those of the field in their place."""
FENCE = re.compile(r"^(`{3,}|~{3,}).*?^\1`*\s*?$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"(?<!!)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
IMAGE = re.compile(r"!\[([^\]]*)\]\(([^)\s]+)\)")
ITEM = re.compile(r"^\s*(?:[-*]|\d+\.)\s+")
SENTENCE = re.compile(r"(?<=[.!?])[\"')*_]*\s+(?=[\"'(*_]*[A-Z0-9`])")
ABBREVIATION = re.compile(r"\b(e\.g|i\.e|etc|vs|Fig|Eq|No|approx)\.\s")
WORD = re.compile(r"[^\W_]")


class Fault(NamedTuple):
    """A place in the manual, what is wrong there, and what to do."""

    page: str
    text: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.page}: {self.text}; {self.remedy}"


def pages() -> list[str]:
    """Every page that a person wrote, named from the top of the repository."""
    found = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    names = (path.relative_to(ROOT).as_posix() for path in found)
    return sorted(one for one in names if "/generated/" not in one)


def faults(page: str) -> Iterator[Fault]:
    """Every fault in the prose of a `page`."""
    text = (ROOT / page).read_text("utf-8")
    yield from broken_links(page, text)
    for sentence in sentences(text):
        yield from (Fault(page, *found) for found in judged(sentence))


def judged(sentence: str) -> Iterator[tuple[str, str]]:
    """Text and remedy of each fault of a `sentence`."""
    count, begin = words(sentence), " ".join(sentence.split()[:8])
    if count > LONGEST:
        yield f"a sentence of {count} words (limit {LONGEST}): '{begin} ...'", "split it"
    plain = re.sub(r"[*_]", "", sentence).strip("\"'()")
    if plain.startswith(STARTS) and not plain.startswith(ALLOWED) and not plain.endswith("?"):
        start = plain.split(" ")[0]
        yield f"a statement begins with '{start}': '{begin} ...'", "name the actor or thing"
    for old, new in WORDS.items():
        if found := re.search(rf"\b(?:{old})\b", sentence, re.IGNORECASE):
            yield f"'{found[0]}' in '{begin} ...'", f"write: {new}"


def sentences(text: str) -> Iterator[str]:
    """The sentences of a page in Markdown, without code, measured tables and markup."""
    text = re.sub(r"\A---\n.*?\n---\n", "", text, flags=re.DOTALL)
    text = re.sub(r"<!-- measured:.*?<!-- end -->|<!--.*?-->", "\n\n", text, flags=re.DOTALL)
    text = FENCE.sub("\n\n", text)
    text = re.sub(r"^ *:{3,}.*$|^\([\w-]+\)=$", "", text, flags=re.MULTILINE)
    text = re.sub(r"\$\$.*?\$\$", "\n\n", text, flags=re.DOTALL)
    text = re.sub(r"``?[^`]+``?|\$[^$\n]+\$", "`x`", text)
    text = LINK.sub(r"\1", IMAGE.sub(r"\1", text))
    for block in blocks(text):
        for sentence in SENTENCE.split(ABBREVIATION.sub(r"\1 ", block)):
            if words(sentence) > 1:
                yield sentence.strip()


def blocks(text: str) -> Iterator[str]:
    """Paragraphs, items of lists, headings, and cells of tables, a line each."""
    block: list[str] = []
    for line in [*text.splitlines(), ""]:
        line = line.removeprefix("> ").removeprefix(">")
        row = line.lstrip().startswith("|")
        if (not line.strip() or row or ITEM.match(line) or line.startswith("#")) and block:
            yield " ".join(block)
            block = []
        if row:
            yield from (cell.strip() for cell in line.strip().strip("|").split("|"))
        elif line.startswith("#"):
            yield line.lstrip("# ")
        elif line.strip():
            block.append(ITEM.sub("", line).strip())


def words(text: str) -> int:
    """Number of words in a `text`."""
    return sum(bool(WORD.search(word)) for word in text.split())


def broken_links(page: str, text: str) -> Iterator[Fault]:
    """Links of a page whose file or heading does not exist; generated pages are not looked at."""
    text = FENCE.sub("", text)
    targets = [target for _, target in (*LINK.findall(text), *IMAGE.findall(text))]
    for target in targets:
        if re.match(r"[a-z]+:", target) or "generated/" in target:
            continue
        name, _, heading = target.partition("#")
        path = (ROOT / page).parent / name if name else ROOT / page
        if not path.exists():
            yield Fault(page, f"a link leads to {target}", "no such file; correct the link")
        elif heading and path.suffix == ".md" and heading not in anchors(path):
            yield Fault(page, f"a link leads to {target}", "no such heading; correct the link")


def anchors(path: Path) -> set[str]:
    """Anchors of a page: of its headings, as GitHub and Sphinx make them, and its targets."""
    text = path.read_text("utf-8")
    for name in re.findall(r"```\{include\} (\S+)", text):
        included = path.parent / name
        text += included.read_text("utf-8") if included.is_file() else ""
    headings = re.findall(r"^#+ +(.+)$", FENCE.sub("", text), re.MULTILINE)
    plain = (LINK.sub(r"\1", one).strip().lower() for one in headings)
    targets = re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE)
    return {*targets, *(re.sub(r"[^\w\- ]", "", one).replace(" ", "-") for one in plain)}


def table(names: list[str]) -> Iterator[str]:
    """Words of each page outside code, and words per sentence."""
    total = 0
    for page in names:
        text = (ROOT / page).read_text("utf-8")
        lengths = [words(one) for one in sentences(text)]
        count = words(FENCE.sub("", text))
        total += count
        yield f"{count:6} {sum(lengths) / max(1, len(lengths)):5.1f}  {page}"
    yield f"{total:6}        {len(names)} pages"


def main(arguments: list[str]) -> int:
    """Print every fault; exit status 1 if there is one."""
    counted = "--count" in arguments
    names = [one for one in arguments if one != "--count"] or pages()
    if counted:
        print("\n".join(table(names)))
        return 0
    found = [fault for page in names for fault in faults(page)]
    print("\n".join(map(str, found)) or f"{len(names)} pages: nothing found")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

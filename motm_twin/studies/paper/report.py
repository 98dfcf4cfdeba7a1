"""The report: draws and saves every part; writes one self-contained HTML file, and the record for citations."""

import base64
import html
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.tuning import PARAMETERS
from motm_twin.measures.measures import STATIC_AFTER
from motm_twin.methods.registry import METHODS
from motm_twin.perception.tracks import TrackParameters
from motm_twin.sessions.session import SOURCE
from motm_twin.studies.paper import data
from motm_twin.studies.paper.data import COMMAND, MACHINE, NOT_RECORDED, PLAN, Origin, Result, Store, current_origin
from motm_twin.studies.paper.drawing import Drawn, Missing, Part, save, write_json
from motm_twin.studies.paper.parts import PARTS, SECTIONS, Context, make_part
from motm_twin.studies.paper.tables import GOAL_HEADER, goal_rows, group_of, missed
from motm_twin.studies.statistics import touches

VERSION = "motm-twin"  # key of this package's version in `Origin.made_with`
FAILED = ("scene", "variant", "seed", "method", "parameters", "changes", "reason")  # listed for a failed trial


def record(store: Store, origin: Origin, command: str, parts: Sequence[Part]) -> dict[str, Any]:
    """Content of ``results.json``: everything but the figures. ``origin``: of the trials; ``command``: draws it now."""
    everything = store.all()
    return {
        "project": "motm_twin",
        "version": origin.made_with.get(VERSION, NOT_RECORDED),
        "source": origin.made_with[SOURCE],
        "sources_of_trials": list(origin.sources),
        "made_with": origin.made_with,
        "machine": origin.machine,
        "plan": origin.plan,
        "command": origin.command,
        "drawn": {"written": datetime.now(UTC).isoformat(timespec="seconds"), COMMAND: command, **current_origin()},
        "trials": len(everything),
        "without_success": [
            {"experiment": name, **{key: result[key] for key in FAILED}}
            for name, result in everything
            if not result["success"]
        ],
        "experiments": {name: _experiment(results) for name, results in store.trials.items()},
        "parameters": {each.name: each.default for each in PARAMETERS},
        "methods": {name: dict(method.parameters) for name, method in METHODS.items()},
        "numbers": [dict(zip(GOAL_HEADER, row, strict=True)) for row in goal_rows(store)],
        "parts": {part.name: _part(part) for part in parts},
    }


def _experiment(results: Sequence[Result]) -> dict[str, Any]:
    """All trials of an experiment; a mean is taken within one group of the results table and one setting."""
    methods = list(dict.fromkeys(result["method"] for result in results))
    return {
        "trials": len(results),
        "scenes": sorted({f"{result['scene']}/{result['variant']}" for result in results}),
        "seeds": sorted({int(result["seed"]) for result in results}),
        "methods": {name: _method([each for each in results if each["method"] == name]) for name in methods},
    }


def _method(results: list[Result]) -> dict[str, Any]:
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(group_of(result), []).append(result)
    alone = _time(results) if len(groups) == 1 else {}
    return {**_counts(results), **alone, "groups": {name: _counts(each) | _time(each) for name, each in groups.items()}}


def _counts(results: list[Result]) -> dict[str, Any]:
    placed, wanted = data.placed(results)
    return {
        "trials": len(results), "completed": sum(map(data.completed, results)),
        "success": sum(bool(result["success"]) for result in results),
        "placed": placed, "wanted": wanted, "contacts_caused": data.contacts(results),
        "contacts": touches(results),
    }  # fmt: skip


def _time(results: list[Result]) -> dict[str, float]:
    time = data.mean_time(results)
    return {"mean_s": time.value, "low_s": time.low, "high_s": time.high}


def _part(part: Part) -> dict[str, Any]:
    if isinstance(part, Missing):
        return {"missing": part.reason, "command": part.command}
    assert isinstance(part, Drawn)
    return {"title": part.title, "n": part.n, "command": part.command, "data": f"figures/{part.name}.csv"}


OPEN = (  # what the paper leaves open, the choice here, and the section of the paper
    ("Speed limits of the base",
     "0.5 m/s and 100°/s: those of the paper's Bézier figure, which reproduce its task times", "Sec. III-E"),
    ("Accelerations of the base", "0.5 m/s² and 1.75 rad/s²: not published, chosen here", "-"),
    ("'Sufficiently close' of the search's termination",
     "paper_literal: 0.15 m and 20°; motm predicts when the job is done", "Sec. III-C"),
    ("Noise of localisation, lidar, camera and slots", "1 cm and 0.5°, 1 cm, 2 mm to 2 cm, 3 cm: chosen here", "-"),
    ("Field of view of the lidar", "all round, at 0.2 m: not published", "-"),
    ("Height of the table, size of the bins",
     "0.78 m ± 0.02 m and 0.4 m: measured in the authors' pictures", "Sec. VI"),
    ("Which drop location comes first", "drop location 1", "Sec. VI-B"),
    ("The second box of Experiment 1a", "where its label says; the drawing has it 0.17 m further left", "Sec. VI-C"),
    ("The fifty random arrangements", "drawn anew from seeds 0 to 49: the paper's are not published", "Sec. VI-B"),
    ("Routes and speed of the Temis",
     "round the table in both directions at 0.4 m/s, yielding: not published", "Sec. VI-D"),
)  # fmt: skip
CHANGED = (
    "The termination of motm is not the printed one: a node finishes the search when the job is predicted to be done "
    "on the way past, and nodes after it are judged by their way on to the next target. paper_literal has the printed "
    "one; both are in the tables.",
    "The proximity penalty of motm is 0.3 s over 0.12 m of clearance; STAA*'s grid over 0.6 m costs about 6 s per "
    "trial beside a table. paper_literal has the grid.",
    "Besides the gripper's centre (Sec. V), elbow, forearm and wrist keep off what the lidar sees, and the whole arm "
    "keeps off mapped furniture.",
    "A static obstacle beside the target lets its d_s shrink during the grasp: else the object could not be reached. "
    f"Static is what was never seen to move and has been in the same place for {STATIC_AFTER:g} s, or was seen to move "
    f"and has rested for {TrackParameters().rests:g} s since. Others keep {AvoidanceParameters().d_s} m.",
    "The damper line bounds the speed of approach. As printed it reads as a bound of the distance's rate.",
)
CANNOT = (
    "Reister et al. ran their methods on ARMAR-6, with 1.55 m of reach. Here they run on Frankie with 0.855 m, on the "
    "same base controller and limits as the paper's method: our rivals, at their best, are not their systems. The "
    "published reductions compare published times; ours compare methods on one robot. Both are shown, and neither "
    "replaces the other.",
    "The paper simulated in Unity, and measured ten trials on a real robot. This is another simulation, with contacts "
    "judged by a referee that shares no code with the controller; it says nothing of a real gripper's grasp.",
    "Box plots of the paper have no numbers. None were read off: only what Table I prints is drawn as published.",
)


def body() -> str:
    """HTML of the section on differences from the paper."""
    methods = [
        (method.title, name, method.source, method.known or "-", method.chosen or "-",
         _equations(method.parameters) or "as shipped")
        for name, method in METHODS.items()
    ]  # fmt: skip
    return (
        "<h3>What the paper leaves open, and what is taken here</h3>"
        + table(("What", "Here", "Paper"), OPEN)
        + "<h3>What is done otherwise</h3>"
        + paragraphs(CHANGED)
        + "<h3>What cannot be compared</h3>"
        + paragraphs(CANNOT)
        + "<h3>Every method: what was known, and what was chosen</h3>"
        + table(("Method", "Name", "Source", "Known", "Chosen here", "Parameters"), methods)
        + f"<p>{text('docs/method.md gives the reason of every choice.')}</p>"
    )


def _equations(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in values.items())


FIGURES, REPORT, RESULTS = "figures", "report.html", "results.json"
PART = "part_of_"  # prefix of the files of a partial report, which do not overwrite the whole one
TITLE = "Reactive base control for manipulation on the move: the experiments, run again"


def write(context: Context, origin: Origin, command: str, names: Sequence[str], notes: Sequence[str] = ()) -> Path:
    """Draw the named parts, write everything into the folder of the context, and return the report's path.

    ``origin``: of the trials; ``command``: draws this report; ``notes``: on the trials, below the title.
    """
    parts: dict[str, Part] = {}
    for source in PARTS:
        if source.name in names:
            parts[source.name] = part = make_part(source, context)
            if isinstance(part, Drawn):
                save(part, context.out / FIGURES)
            else:
                context.console.print(f"  {part.name}: not made, {part.reason}", markup=False)
    cited = record(context.store, origin, command, list(parts.values()))
    prefix = "" if len(parts) == len(PARTS) else PART
    write_json(context.out / f"{prefix}{RESULTS}", cited)
    document = page(TITLE, _lead(cited, stale(origin), notes), _sections(context, parts, cited))
    target = context.out / f"{prefix}{REPORT}"
    target.write_text(document, encoding="utf-8")
    return target


def stale(origin: Origin) -> list[str]:
    """A warning when not all trials were run by the current source; else nothing."""
    if origin.current:
        return []
    return [
        f"Warning: the trials were run by source {', '.join(origin.sources)}, this report was drawn by "
        f"{current_origin()[SOURCE]}. The numbers below tell of the former."
    ]


def _lead(record: dict, warnings: Sequence[str], notes: Sequence[str]) -> str:
    failed, drawn = len(record["without_success"]), record["drawn"]
    summary = (
        f"motm_twin {record['version']}, source {record['source']}; {record['trials']} trials, {failed} of them "
        f"without success; plan: {record['plan']}; {record['machine']}."
    )
    return (
        paragraphs(warnings, "missing")
        + paragraphs([summary, *notes])
        + f'<p class="about">The trials were run by <code>{text(record["command"])}</code>; drawn '
        f"{drawn['written']} by <code>{text(drawn['command'])}</code>, source {drawn['source']}.</p>"
    )


def _sections(context: Context, parts: dict[str, Part], record: dict) -> Iterator[tuple[str, str, str]]:
    """Anchor, title and HTML of every section."""
    yield "numbers", "The numbers to reach", f"{_numbers(context)}\n"
    for anchor, title in SECTIONS.items():
        these = [parts[source.name] for source in PARTS if source.section == anchor and source.name in parts]
        if these:
            yield anchor, title, "\n" + "\n".join(_shown(part, context.out / FIGURES) for part in these)
    yield "differences", "What differs from the paper", f"{body()}\n"
    yield "failed", "Trials without success", f"{_failed(record)}\n"
    yield "made", "How this was made, and how to cite it", f"{_made(record, parts)}\n"


def _numbers(context: Context) -> str:
    rows = goal_rows(context.store)
    remark = "motm is the paper's method, fast our own. A verdict needs 50 trials; with fewer it says 'so far'."
    return (
        paragraphs([remark])
        + table(GOAL_HEADER, rows)
        + paragraphs(missed(rows))
        + '<p class="about">Fifty trials of each: <code>'
        + text(context.command(plan="full"))
        + "</code>; one of them: <code>motm-twin run SCENE --variant random --seed N --method METHOD</code>.</p>"
    )


def _failed(record: dict) -> str:
    failed = record["without_success"]
    if not failed:
        return "<p>None.</p>"
    rows = [
        (each["experiment"], f"{each['scene']}/{each['variant']}", str(each["seed"]), each["method"],
         _equations({**each["parameters"], **each["changes"]}) or "-", each["reason"])
        for each in failed
    ]  # fmt: skip
    note = (
        "None is dropped: means of times are over completed trials, and the number of the others stands beside them. "
        "Each has its session in EXPERIMENT/sessions, which motm-twin rerun repeats."
    )
    return paragraphs([note]) + table(("Experiment", "Scene", "Seed", "Method", "Changed", "Reason"), rows)


def _made(record: dict, parts: dict[str, Part]) -> str:
    drawn = record["drawn"]
    ran = {**record["made_with"], **{name: record[name] for name in (MACHINE, PLAN, COMMAND)}}
    rows = [(name, str(value), str(drawn.get(name, "-"))) for name, value in ran.items()]
    experiments = [
        (name, str(each["trials"]), ", ".join(each["methods"]), ", ".join(each["scenes"]), _range(each["seeds"]))
        for name, each in record["experiments"].items()
    ]
    missing = [part.title for part in parts.values() if isinstance(part, Missing)]
    lines = [
        "Cite the version, the source hash, the command, and the machine: results.json beside this file has them with "
        "all parameters and seeds, and EXPERIMENT/results.jsonl has every trial. The same source, seeds and versions "
        "of the numeric libraries give the same trials, bit for bit.",
    ]
    if missing:
        lines.append(f"Not in this report: {', '.join(missing)}.")
    header = ("Experiment", "Trials", "Methods", "Scenes", "Seeds")
    return paragraphs(lines) + table(header, experiments) + table(("What", "Ran the trials", "Drew this"), rows)


def _range(seeds: list[int]) -> str:
    whole = seeds == list(range(seeds[0], seeds[-1] + 1)) if seeds else False
    return f"{seeds[0]} to {seeds[-1]}" if whole and len(seeds) > 2 else ", ".join(map(str, seeds))


NARROW = 5.0  # [inch] narrower figures are for one column, and shown smaller
CSS = """
:root { color-scheme: light dark; --ink: #1b1b1b; --ground: #fdfdfc; --soft: #666; --line: #ccc; --mark: #f3ead2; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e6; --ground: #1a1b1d; --soft: #a5a5a5; --line: #444; --mark: #4a4028; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--ground); margin: 0 auto;
  max-width: 62rem; padding: 1.5rem; }
h1 { font-size: 1.7rem; line-height: 1.25; } h2 { margin-top: 3rem; border-bottom: 1px solid var(--line); }
h3 { margin-top: 2.2rem; } nav ul { columns: 2; padding-left: 1.2rem; }
a { color: inherit; } code { font-size: 0.86em; overflow-wrap: anywhere; }
img { max-width: 100%; height: auto; background: #fff; border: 1px solid var(--line); border-radius: 4px; }
img.narrow { width: 34rem; }
figure { margin: 1rem 0; }
figcaption, .about { font-size: 0.9rem; } .about { color: var(--soft); }
.scroll { overflow-x: auto; margin-bottom: 1.5rem; }
table { border-collapse: collapse; font-size: 0.88rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 0.25rem 0.7rem 0.25rem 0; vertical-align: top;
  border-bottom: 1px solid var(--line); }
tr.published { background: var(--mark); font-style: italic; }
.missing { border-left: 4px solid #D55E00; padding-left: 1rem; }
@media print { body { max-width: none; } nav { display: none; } }
"""


def page(title: str, lead: str, sections: Iterable[tuple[str, str, str]]) -> str:
    """The whole HTML document. ``lead``: HTML below the title; ``sections``: anchor, title and HTML of each."""
    links, chapters = "", []
    for anchor, name, content in sections:
        links += f'<li><a href="#{anchor}">{text(name)}</a></li>'
        chapters.append(f'<section id="{anchor}">\n<h2>{text(name)}</h2>\n{content}\n</section>')
    body = "\n".join(chapters)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{text(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{CSS}</style>\n</head>\n<body>\n<h1>{text(title)}</h1>\n{lead}\n<nav><ul>{links}</ul></nav>\n{body}\n</body>\n</html>\n"
    )


def text(value: object) -> str:
    """Plain text, escaped."""
    return html.escape(str(value))


def table(header: Sequence[str], rows: Sequence[Sequence[str]], marked: Sequence[int] = ()) -> str:
    """HTML of a table of plain text; rows ``marked`` are styled as published."""
    head = "".join(f"<th>{text(each)}</th>" for each in header)
    body = "".join(
        f"<tr{_class('published' if index in marked else '')}>"
        + "".join(f"<td>{text(cell)}</td>" for cell in cells)
        + "</tr>"
        for index, cells in enumerate(rows)
    )
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def paragraphs(sentences: Iterable[str], kind: str = "") -> str:
    """HTML with one paragraph per sentence; ``kind``: class in the style sheet."""
    return "".join(f"<p{_class(kind)}>{text(each)}</p>" for each in sentences)


def _class(kind: str) -> str:
    return f' class="{kind}"' if kind else ""


def _base64(file: Path) -> str:
    return base64.b64encode(file.read_bytes()).decode()


def _shown(part: Part, folder: Path) -> str:
    if isinstance(part, Missing):
        return (
            f'<div class="missing" id="{part.name}"><h3>{text(part.title)}</h3>'
            f"<p>Not in this report: {text(part.reason)}.</p>"
            f'<p class="about">Command: <code>{text(part.command)}</code>.</p></div>'
        )
    stem, caption = folder / part.name, text(part.caption)
    shown = ""
    if part.figure is not None:
        kind, picture = "narrow" if part.figure.get_figwidth() < NARROW else "", _base64(stem.with_suffix(".png"))
        shown = f'<img{_class(kind)} alt="{text(part.title)}: {caption}" src="data:image/png;base64,{picture}">'
    rows = [tuple(row.values()) for row in part.cells]
    cells = table(tuple(part.cells[0]), rows, part.marked) if rows else ""
    numbers = _base64(stem.with_suffix(".csv"))  # for the download link
    return (
        f'<div id="{part.name}"><h3>{text(part.title)}</h3>\n'
        f"<figure>{shown}<figcaption>{caption}</figcaption></figure>\n{cells}\n{paragraphs(part.notes)}\n"
        f'<p class="about">n: {text(part.n)}. Made by <code>{text(part.command)}</code>. '
        f'<a download="{part.name}.csv" href="data:text/csv;base64,{numbers}">Data (CSV)</a></p></div>'
    )

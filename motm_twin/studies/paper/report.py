"""The report: every part drawn and saved, the HTML page, and the record that a citation needs."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.tuning import PARAMETERS
from motm_twin.measures.gripper import STATIC_AFTER
from motm_twin.methods.registry import METHODS
from motm_twin.perception.movers import MoverParameters
from motm_twin.sessions.session import SOURCE
from motm_twin.studies.groups import touches
from motm_twin.studies.paper import data, goals, html
from motm_twin.studies.paper.data import COMMAND, MACHINE, NOT_RECORDED, PLAN, Origin, Result, Store, current_origin
from motm_twin.studies.paper.html import Section, paragraphs, table, text
from motm_twin.studies.paper.part import Drawn, Missing, Part, save, write_json
from motm_twin.studies.paper.parts import PARTS, SECTIONS, Context, make_part
from motm_twin.studies.paper.tables import group_of

VERSION = "motm-twin"  # of this package, in what a trial was made with


def record(store: Store, origin: Origin, command: str, parts: Sequence[Part]) -> dict[str, Any]:
    """``results.json``: everything but the figures. ``origin``: of the trials; ``command``: that draws them now."""
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
        "without_success": [_without_success(name, result) for name, result in everything if not result["success"]],
        "experiments": {name: _experiment(results) for name, results in store.trials.items()},
        "parameters": {each.name: each.default for each in PARAMETERS},
        "methods": {name: dict(method.parameters) for name, method in METHODS.items()},
        "numbers": [dict(zip(goals.HEADER, row, strict=True)) for row in goals.table(store)],
        "parts": {part.name: _part(part) for part in parts},
    }


def _experiment(results: Sequence[Result]) -> dict[str, Any]:
    """All trials of an experiment; a mean is within one group of the results table, or within one setting."""
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


def _without_success(name: str, result: Result) -> dict[str, Any]:
    return {
        "experiment": name,
        **{key: result[key] for key in ("scene", "variant", "seed", "method", "parameters", "changes", "reason")},
    }


def _part(part: Part) -> dict[str, Any]:
    if isinstance(part, Missing):
        return {"missing": part.reason, "command": part.command}
    assert isinstance(part, Drawn)
    return {"title": part.title, "n": part.n, "command": part.command, "data": f"figures/{part.name}.csv"}


OPEN = (
    (
        "Speed limits of the base",
        "0.5 m/s and 100°/s: those of the paper's Bézier figure, which reproduce its task times",
        "Sec. III-E",
    ),
    ("Accelerations of the base", "0.5 m/s² and 1.75 rad/s²: not published, chosen here", "-"),
    (
        "'Sufficiently close' of the search's termination",
        "paper_literal: 0.15 m and 20°; motm predicts when the job is done",
        "Sec. III-C",
    ),
    ("Noise of localisation, lidar, camera and slots", "1 cm and 0.5°, 1 cm, 2 mm to 2 cm, 3 cm: chosen here", "-"),
    ("Field of view of the lidar", "all round, at 0.2 m: not published", "-"),
    (
        "Height of the table, size of the bins",
        "0.78 m ± 0.02 m and 0.4 m: measured in the authors' pictures",
        "Sec. VI",
    ),
    ("Which drop location comes first", "drop location 1", "Sec. VI-B"),
    ("The second box of Experiment 1a", "where its label says; the drawing has it 0.17 m further left", "Sec. VI-C"),
    ("The fifty random arrangements", "drawn anew from seeds 0 to 49: the paper's are not published", "Sec. VI-B"),
    (
        "Routes and speed of the Temis",
        "round the table in both directions at 0.4 m/s, yielding: not published",
        "Sec. VI-D",
    ),
)
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
    f"and has rested for {MoverParameters().waits:g} s since. Others keep {AvoidanceParameters().d_s} m.",
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
    """The section, as HTML."""
    methods = [
        (
            method.title,
            name,
            method.source,
            method.known or "-",
            method.chosen or "-",
            ", ".join(f"{key} = {value}" for key, value in method.parameters.items()) or "as shipped",
        )
        for name, method in METHODS.items()
    ]
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


FIGURES, REPORT, RESULTS = "figures", "report.html", "results.json"
PART = "part_of_"  # before the names of files that have not everything, so that the whole report stays
TITLE = "Reactive base control for manipulation on the move: the experiments, run again"


def write(context: Context, origin: Origin, command: str, names: Sequence[str], notes: Sequence[str] = ()) -> Path:
    """Draw the named parts, write everything into the folder of the context; the report's path.

    ``origin``: of the trials; ``command``: that draws them now; ``notes``: on the trials, below the title.
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
    document = html.page(
        TITLE, _lead(cited, stale(origin), notes), _sections(context, parts, cited), context.out / FIGURES
    )
    target = context.out / f"{prefix}{REPORT}"
    target.write_text(document, encoding="utf-8")
    return target


def stale(origin: Origin) -> list[str]:
    """A warning where the trials are not all of the source that draws them."""
    if origin.current:
        return []
    return [
        f"Warning: the trials were run by source {', '.join(origin.sources)}, this report was drawn by "
        f"{current_origin()[SOURCE]}. The numbers below tell of the former."
    ]


def _lead(record: dict, warnings: Sequence[str], notes: Sequence[str]) -> str:
    failed, drawn = len(record["without_success"]), record["drawn"]
    said = [
        f"motm_twin {record['version']}, source {record['source']}; {record['trials']} trials, {failed} of them "
        f"without success; plan: {record['plan']}; {record['machine']}.",
        *notes,
    ]
    return (
        html.warnings(warnings)
        + html.paragraphs(said)
        + (
            f'<p class="about">The trials were run by <code>{html.text(record["command"])}</code>; drawn '
            f"{drawn['written']} by <code>{html.text(drawn['command'])}</code>, source {drawn['source']}.</p>"
        )
    )


def _sections(context: Context, parts: dict[str, Part], record: dict) -> list[Section]:
    sections = [Section("numbers", "The numbers to reach", body=_numbers(context))]
    for anchor, title in SECTIONS.items():
        these = [parts[source.name] for source in PARTS if source.section == anchor and source.name in parts]
        if these:
            sections.append(Section(anchor, title, these))
    sections.append(Section("differences", "What differs from the paper", body=body()))
    sections.append(Section("failed", "Trials without success", body=_failed(record)))
    sections.append(Section("made", "How this was made, and how to cite it", body=_made(record, parts)))
    return sections


def _numbers(context: Context) -> str:
    rows = goals.table(context.store)
    said = "motm is the paper's method, fast our own. A verdict needs 50 trials; with fewer it says 'so far'."
    return (
        html.paragraphs([said])
        + html.table(goals.HEADER, rows)
        + html.paragraphs(goals.missed(rows))
        + '<p class="about">Fifty trials of each: <code>'
        + html.text(context.command(plan="full"))
        + "</code>; one of them: <code>motm-twin run SCENE --variant random --seed N --method METHOD</code>.</p>"
    )


def _failed(record: dict) -> str:
    failed = record["without_success"]
    if not failed:
        return "<p>None.</p>"
    rows = [
        (
            each["experiment"],
            f"{each['scene']}/{each['variant']}",
            str(each["seed"]),
            each["method"],
            ", ".join(f"{key} = {value}" for key, value in {**each["parameters"], **each["changes"]}.items()) or "-",
            each["reason"],
        )
        for each in failed
    ]
    note = (
        "None is dropped: means of times are over completed trials, and the number of the others stands beside them. "
        "Each has its session in EXPERIMENT/sessions, which motm-twin rerun repeats."
    )
    return html.paragraphs([note]) + html.table(("Experiment", "Scene", "Seed", "Method", "Changed", "Reason"), rows)


def _made(record: dict, parts: dict[str, Part]) -> str:
    drawn = record["drawn"]
    ran = {**record["made_with"], **{name: record[name] for name in (MACHINE, PLAN, COMMAND)}}
    rows = [(name, str(value), str(drawn.get(name, "-"))) for name, value in ran.items()]
    experiments = [
        (name, str(each["trials"]), ", ".join(each["methods"]), ", ".join(each["scenes"]), _range(each["seeds"]))
        for name, each in record["experiments"].items()
    ]
    missing = [part.title for part in parts.values() if isinstance(part, Missing)]
    said = [
        "Cite the version, the source hash, the command, and the machine: results.json beside this file has them with "
        "all parameters and seeds, and EXPERIMENT/results.jsonl has every trial. The same source, seeds and versions "
        "of the numeric libraries give the same trials, bit for bit.",
    ]
    if missing:
        said.append(f"Not in this report: {', '.join(missing)}.")
    header = ("Experiment", "Trials", "Methods", "Scenes", "Seeds")
    return (
        html.paragraphs(said)
        + html.table(header, experiments)
        + html.table(("What", "Ran the trials", "Drew this"), rows)
    )


def _range(seeds: list[int]) -> str:
    whole = seeds == list(range(seeds[0], seeds[-1] + 1)) if seeds else False
    return f"{seeds[0]} to {seeds[-1]}" if whole and len(seeds) > 2 else ", ".join(map(str, seeds))

"""Sessions that were recorded once run to the same state today, bit for bit.

After a wanted change of behaviour: ``motm-twin rerun tests/recorded/NAME.json --update``.
"""

import warnings
from pathlib import Path

import pytest

from motm_twin.cli.run import explain
from motm_twin.record.replay import rerun
from motm_twin.sessions.session import load_session

FILES = sorted(Path(__file__).parent.glob("*.json"))


def test_there_are_recorded_sessions():
    assert len(FILES) >= 3


@pytest.mark.slow
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_recorded_session_reruns_to_its_state(path):
    session = load_session(path)
    again = rerun(session)
    if not again.ok:
        pytest.fail(f"{path.name}\n{explain(again)}\nIs the change meant? Then: motm-twin rerun {path} --update")
    versions = [said for said in again.differences if "another motm_twin" not in said]  # equal: what it is all about
    if versions:
        warnings.warn(
            f"{path.name} was made with other versions: {', '.join(versions)}; it is equal all the same", stacklevel=1
        )

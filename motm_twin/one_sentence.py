"""What a user of a program gets to read when it cannot go on: one sentence, and no traceback."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from motm_twin.bus.commands import Refused
from motm_twin.bus.zenoh_config import ConfigError
from motm_twin.client.discover import NoTwin
from motm_twin.exit_codes import BAD_INPUT, INTERRUPTED
from motm_twin.model.names import MethodError
from motm_twin.model.scene_error import SceneError


@contextmanager
def one_sentence() -> Iterator[None]:
    """Decorate the ``main`` of a program, ``@one_sentence()``: it ends with a sentence for what its user can put right.

    That is a scene, method or configuration that cannot be used, a twin that is not there, refuses or does not answer
    in time (exit code 2), and Ctrl-C (130). Every other exception passes, with its traceback.
    """
    try:
        yield
    except (SceneError, MethodError, ConfigError, NoTwin, Refused, TimeoutError) as error:
        print(error, file=sys.stderr)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        sys.exit(INTERRUPTED)

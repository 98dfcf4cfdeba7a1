"""Print the ticks of every twin behind an endpoint. Needs only Zenoh: pip install eclipse-zenoh."""

import os
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import zenoh

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
file = f"motm-twin-{os.getuid()}/zenoh-{endpoint.rsplit(':')[-1]}.json5"  # with the password, by `motm-twin serve`
own = Path(tempfile.gettempdir(), file)
config = zenoh.Config.from_file(str(own)) if own.exists() else zenoh.Config()
config.insert_json5("connect/endpoints", f'["{endpoint}"]')
config.insert_json5("listen/endpoints", "[]")
config.insert_json5("scouting/multicast/enabled", "false")
with suppress(KeyboardInterrupt), zenoh.open(config) as session:
    ticks = session.declare_subscriber("motm/*/tick", zenoh.handlers.RingChannel(1))
    for sample in ticks:
        print(sample.key_expr, sample.payload.to_string()[:200], flush=True)

"""Print the ticks of every twin behind an endpoint. Needs only Zenoh: pip install eclipse-zenoh."""

import argparse
import os
import tempfile
from contextlib import suppress
from pathlib import Path

import zenoh

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("endpoint", nargs="?", default="tcp/127.0.0.1:7447")
endpoint = parser.parse_args().endpoint
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

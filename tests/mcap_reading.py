"""Reads recordings in MCAP by its own reader, for tests."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

Row = tuple[int, str, Any]  # log time [ns], name of the type, message


def mcap_rows(file: Path) -> dict[str, list[Row]]:
    """Topic to its messages in their order, of a file that was closed."""
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    found = defaultdict(list)
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, value in reader.iter_decoded_messages():
            assert schema is not None
            found[channel.topic].append((message.log_time, schema.name, value))
    return dict(found)

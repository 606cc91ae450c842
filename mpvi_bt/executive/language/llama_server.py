"""Serves a language model's file by llama.cpp, on loopback: `python -m mpvi_bt.executive.language.llama_server FILE`.

The process of a `LocalModel`. It prints one line of JSON once the model is loaded, {"url": "http://127.0.0.1:PORT/v1"}
or {"error": "..."}, and ends with its standard input, so that it never outlives who started it, however that ends.
"""

from __future__ import annotations

import json
import os
import sys

from mpvi_bt.ground.standard_streams import keep_stdout

CONTEXT = 8192  # tokens of question and answer: what SmolLM2 was trained on; a question takes some 3000
LONGEST_ANSWER = 2048  # tokens; Our choice: small models may repeat themselves for ever. A segment takes some 60
_MOST_THREADS = 8  # Our choice: more gain little with small models


def main(file: str) -> None:
    """Serve `file` until standard input ends."""
    told, sys.stdout = keep_stdout(), sys.stderr  # what llama.cpp prints is not for who started us
    try:
        import xllamacpp

        parameters = xllamacpp.CommonParams()
        parameters.model.path = file
        parameters.n_ctx, parameters.n_predict, parameters.n_parallel = CONTEXT, LONGEST_ANSWER, 1
        parameters.cpuparams.n_threads = min(len(os.sched_getaffinity(0)), _MOST_THREADS)
        parameters.sampling.seed = 0  # the same question, the same answer
        parameters.port, parameters.ui, parameters.verbosity = 0, False, 0
        server = xllamacpp.Server(parameters)
        said = {"url": f"{server.listening_address}/v1"}
    except Exception as error:  # of the library, whatever it is
        said = {"error": str(error) or type(error).__name__}
    print(json.dumps(said), file=told, flush=True)
    if "url" in said:
        sys.stdin.read()
    os._exit(0)  # it holds nothing that must be saved, and an answer under way is not waited for


if __name__ == "__main__":
    main(sys.argv[1])

"""Our policies as a model server, for `vla-eval serve` (docs/vla_eval.md)."""

from vla_eval.model_servers.serve import run_server

from mpvi_bt.runs.serving.vla_eval_server import MpviModelServer

run_server(MpviModelServer)

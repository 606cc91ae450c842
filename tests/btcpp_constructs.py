"""One small file for each construct of BehaviorTree.CPP 4, and the table of what becomes of them.

`python -m tests.btcpp_constructs` prints the table, which docs/btcpp_constructs.md holds.
"""

from __future__ import annotations

from mpvi_bt.executive.btcpp.importing import ImportedTrees, from_xml
from mpvi_bt.ground.errors import FileProblems

_A, _B, _C = ('<Say text="a"/>', '<Say text="b"/>', '<Say text="c"/>')
_ONE = '<BehaviorTree ID="t"><Say text="a"/></BehaviorTree>'


def _root(inner: str, more: str = "") -> str:
    return f'<root BTCPP_format="4" {more}>\n{inner}\n</root>'


def _calls(call: str, models: str = "") -> str:
    trees = (
        f'<BehaviorTree ID="t">{call}</BehaviorTree><BehaviorTree ID="go"><Navigate target="{{to}}"/></BehaviorTree>'
    )
    return _root(f"{trees}<TreeNodesModel>{models}</TreeNodesModel>", 'main_tree_to_execute="t"')


def _model(ports: str) -> str:
    return _root(f"{_ONE}<TreeNodesModel><Action ID='Say'>{ports}</Action></TreeNodesModel>")


# What it is called in the table, and a file; without <root>, the nodes of its one tree.
CONSTRUCTS: dict[str, str] = {
    "`Sequence`": f"<Sequence>{_A}{_B}</Sequence>",
    "`ReactiveSequence`": f"<ReactiveSequence>{_A}{_B}</ReactiveSequence>",
    "`SequenceWithMemory`": f"<SequenceWithMemory>{_A}{_B}</SequenceWithMemory>",
    "`AsyncSequence`": f"<AsyncSequence>{_A}{_B}</AsyncSequence>",
    "`Fallback`": f"<Fallback>{_A}{_B}</Fallback>",
    "`ReactiveFallback`": f"<ReactiveFallback>{_A}{_B}</ReactiveFallback>",
    "`AsyncFallback`": f"<AsyncFallback>{_A}{_B}</AsyncFallback>",
    "`Parallel`": f"<Parallel>{_A}{_B}</Parallel>",
    '`Parallel success_count="1"`': f'<Parallel success_count="1">{_A}{_B}</Parallel>',
    '`Parallel failure_count="2"`': f'<Parallel failure_count="2">{_A}{_B}</Parallel>',
    "`ParallelAll`": f'<ParallelAll max_failures="1">{_A}{_B}</ParallelAll>',
    "`IfThenElse`": f"<IfThenElse>{_A}{_B}{_C}</IfThenElse>",
    "`WhileDoElse`": f"<WhileDoElse>{_A}{_B}{_C}</WhileDoElse>",
    "`TryCatch`": f'<TryCatch catch_on_halt="true">{_A}{_B}</TryCatch>',
    "`Switch2`": f'<Switch2 variable="{{n}}" case_1="1" case_2="hall">{_A}{_B}{_C}</Switch2>',
    "`Switch3`": f'<Switch3 variable="{{n}}" case_1="1" case_2="2" case_3="3">{_A}{_A}{_B}{_C}</Switch3>',
    "`Switch4`": f'<Switch4 variable="{{n}}" case_1="1" case_2="2" case_3="3" case_4="4">{_A * 5}</Switch4>',
    "`Switch5`": '<Switch5 variable="{n}" '
    + " ".join(f'case_{i}="{i}"' for i in range(1, 6))
    + f">{_A * 6}</Switch5>",
    "`Switch6`": '<Switch6 variable="{n}" '
    + " ".join(f'case_{i}="{i}"' for i in range(1, 7))
    + f">{_A * 7}</Switch6>",
    "`ManualSelector`": f'<ManualSelector repeat_last_selection="0">{_A}{_B}</ManualSelector>',
    "`Inverter`": f"<Inverter>{_A}</Inverter>",
    "`ForceSuccess`": f"<ForceSuccess>{_A}</ForceSuccess>",
    "`ForceFailure`": f"<ForceFailure>{_A}</ForceFailure>",
    "`Repeat`": f'<Repeat num_cycles="3">{_A}</Repeat>',
    '`Repeat num_cycles="-1"`': f'<Repeat num_cycles="-1">{_A}</Repeat>',
    "`RetryUntilSuccessful`": f'<RetryUntilSuccessful num_attempts="3">{_A}</RetryUntilSuccessful>',
    "`KeepRunningUntilFailure`": f"<KeepRunningUntilFailure>{_A}</KeepRunningUntilFailure>",
    "`Timeout`": f'<Timeout msec="1500">{_A}</Timeout>',
    "`Delay`": f'<Delay delay_msec="1500">{_A}</Delay>',
    "`RunOnce`": f'<RunOnce then_skip="true">{_A}</RunOnce>',
    "`Precondition`": f'<Precondition if="n == 1" else="SUCCESS">{_A}</Precondition>',
    '`Precondition else="RUNNING"`': f'<Precondition if="n == 1" else="RUNNING">{_A}</Precondition>',
    "`LoopInt`": f'<LoopInt queue="1;2" if_empty="SUCCESS" value="{{n}}">{_A}</LoopInt>',
    "`LoopDouble`": f'<LoopDouble queue="1;2" if_empty="SUCCESS" value="{{n}}">{_A}</LoopDouble>',
    "`LoopBool`": f'<LoopBool queue="true" if_empty="SUCCESS" value="{{n}}">{_A}</LoopBool>',
    "`LoopString`": f'<LoopString queue="a;b" if_empty="SUCCESS" value="{{n}}">{_A}</LoopString>',
    "`ConsumeQueue`": f'<ConsumeQueue queue="{{q}}" popped_item="{{n}}">{_A}</ConsumeQueue>',
    "`SkipUnlessUpdated`": f'<SkipUnlessUpdated entry="{{n}}">{_A}</SkipUnlessUpdated>',
    "`WaitValueUpdate`": f'<WaitValueUpdate entry="{{n}}">{_A}</WaitValueUpdate>',
    "`WasEntryUpdated`": '<WasEntryUpdated entry="{n}"/>',
    "`AlwaysSuccess`": "<AlwaysSuccess/>",
    "`AlwaysFailure`": '<AlwaysFailure name="no_cup"/>',
    "`Sleep`": '<Sleep msec="1500"/>',
    "`Script`": "<Script code=\"n := 3; room := 'hall'; n += 1\"/>",
    "`Script` that computes": '<Script code="n := m * 2"/>',
    "`ScriptCondition`": '<ScriptCondition code="n >= 2 &amp;&amp; n != 5"/>',
    "conditions with `<`, `>`, and, or, not": (
        "<ScriptCondition code=\"n > 2 || (m &lt; 5 &amp;&amp; !(k == 'a'))\"/>"
    ),
    "a key alone in a condition": '<ScriptCondition code="done"/>',
    "a condition that computes": '<ScriptCondition code="n + 1 > m"/>',
    "`SetBlackboard`": '<SetBlackboard value="hall" output_key="room"/>',
    "`UnsetBlackboard`": '<UnsetBlackboard key="n"/>',
    "`_failureIf`": '<Say text="a" _failureIf="n == 1"/>',
    "`_successIf`": '<Say text="a" _successIf="n == 1"/>',
    "`_skipIf` below a sequence or fallback": '<Sequence><Say text="a" _skipIf="n == 1"/></Sequence>',
    "`_skipIf` elsewhere": '<Inverter><Say text="a" _skipIf="n == 1"/></Inverter>',
    "`_while` below a fallback": '<Fallback><Say text="a" _while="n == 1"/></Fallback>',
    "`_while` elsewhere": '<Sequence><Say text="a" _while="n == 1"/></Sequence>',
    "`_onSuccess`": '<Say text="a" _onSuccess="n := 1"/>',
    "`_onFailure`": '<Say text="a" _onFailure="n := 1"/>',
    "`_onHalted`": '<Say text="a" _onHalted="n := 1"/>',
    "`_post`": '<Say text="a" _post="n := 1"/>',
    "`name`": f'<Sequence name="both">{_A}{_B}</Sequence>',
    "`name` of a node that has none here": '<Say name="greeting" text="a"/>',
    "`_description` of a tree": _root(_ONE.replace('"t"', '"t" _description="two words" _fullpath="" _uid="1"')),
    "`_description` of a node": '<Say text="a" _description="two words"/>',
    "`_uid`, `_fullpath`, `_collapsed`": '<Say text="a" _uid="1" _fullpath="t/a" _collapsed="true"/>',
    "an attribute with `_` that is none": '<Sequence _skipif="n == 1"><Say text="a"/></Sequence>',
    "a port that the node does not have": '<Say text="a" loud="true"/>',
    "`Action`, `Condition`, `Control`, `Decorator` with `ID`": '<Control ID="Sequence"><Decorator ID="Inverter">'
    '<Condition ID="ScriptCondition" code="n == 1"/></Decorator><Action ID="Say" text="a"/></Control>',
    "a node of your own": '<OpenGripper width="0.1"/>',
    "`SubTree`": _calls('<SubTree ID="go" to="{=}"/>'),
    "`SubTree` with a text": _calls('<SubTree ID="go" to="cup"/>'),
    "`SubTree` with another key": _calls('<SubTree ID="go" to="{place}"/>'),
    "`SubTree _autoremap`": _calls('<SubTree ID="go" _autoremap="true"/>'),
    "`SubTree` with keys of its own": _calls('<SubTree ID="go"/>'),
    "`SubTree` in `TreeNodesModel`, a default": _calls(
        '<SubTree ID="go"/>', '<SubTree ID="go"><input_port name="to" default="cup"/></SubTree>'
    ),
    "`SubTree` in `TreeNodesModel`, a mandatory port": _calls(
        '<SubTree ID="go"/>', '<SubTree ID="go"><inout_port name="to"/></SubTree>'
    ),
    "`input_port`, `output_port` of a node": _model(
        "<input_port name='text' type='std::string' description='d'>what</input_port><output_port name='x'/>"
    ),
    "`default` of a node's port": _root(
        '<BehaviorTree ID="t"><LookAround/></BehaviorTree><TreeNodesModel><Action ID="LookAround">'
        '<input_port name="degrees" default="90"/></Action></TreeNodesModel>'
    ),
    "`editable`, `description`, `MetadataFields`": _model(
        "<description>d</description><MetadataFields><Metadata owner='lab'/></MetadataFields>"
    ).replace("ID='Say'", "ID='Say' editable='true'"),
    "`main_tree_to_execute`": _root(_ONE + _ONE.replace('"t"', '"u"'), 'main_tree_to_execute="u"'),
    "no `main_tree_to_execute`, one outermost tree": _calls('<SubTree ID="go" to="cup"/>').replace(
        ' main_tree_to_execute="t"', ""
    ),
    "no `main_tree_to_execute`, several": _root(_ONE + _ONE.replace('"t"', '"u"')),
    "`project_name`, `xmlns:xsi`": _root(
        _ONE, 'project_name="p" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        'xsi:noNamespaceSchemaLocation="schema.xsd"'
    ),
    "another attribute of `root`": _root(_ONE, 'author="me"'),
    '`BTCPP_format="3"`': _root(_ONE).replace('"4"', '"3"'),
    "`include`": _root('<include path="more.xml" ros_pkg="p"/>' + _ONE),
    "an element that is none": _root(_ONE + "<Metadata/>"),
    "comments, and texts between elements": "<!-- a --><Sequence>text<Say text='a'/></Sequence>",
}  # fmt: skip


def xml_of(construct: str) -> str:
    """The small file of a construct."""
    xml = CONSTRUCTS[construct]
    return xml if xml.startswith("<root") else _root(f'<BehaviorTree ID="t">{xml}</BehaviorTree>')


def outcome(construct: str) -> tuple[str, str]:
    """What becomes of it: "read", "remark" or "refused"; and what is told."""
    try:
        imported: ImportedTrees = from_xml(xml_of(construct), "t.xml")
    except FileProblems as error:
        return "refused", error.problems[0].message
    told = [p.message for p in imported.warnings]
    return ("remark", told[0]) if told else ("read", "")


def table() -> str:
    """The table of all constructs."""
    rows = ["| construct | | what is told |", "|---|---|---|"]
    for construct in CONSTRUCTS:
        what, told = outcome(construct)
        rows.append(f"| {construct} | {what} | {_short(told)} |".replace("|  |", "| |"))
    return "\n".join(rows)


def _short(told: str) -> str:
    """Without the list of all that is known, and without what a table takes for marks."""
    text = told.partition(" Known: ")[0].replace("|", "\\|").replace("<", "&lt;").replace("*", "\\*")
    return text.replace("_", "\\_")


if __name__ == "__main__":
    print(table())

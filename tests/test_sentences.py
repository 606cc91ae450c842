"""Laws of what sentences mean: the skill that each names, the words of its slots, and where a prompt is cut in two."""

from __future__ import annotations

import pytest

from mpvi_bt.executive.plan.clauses import clauses, match
from mpvi_bt.executive.plan.skills import load_skills

SKILLS = load_skills()

NATURAL = """
pick up the red cup from the kitchen table | pick | object red cup, source kitchen table
Please pick up the cup. | pick | object cup
pick up  the cup , | pick | object cup
carefully pick up the vase with your left hand | pick | object vase, hand left
pick the apple | pick | object apple
pick the apple up | pick | object apple
pick up the can on its side | pick | object can
pick up the bottle lying on its side with the right hand | pick | object bottle, hand right
pick up the can on the left | pick | object can on the left
pick up the salt and pepper | pick | object salt and pepper
pick up the open book | pick | object open book
pick up a can of soda on the floor by the sofa | pick | object can of soda, source floor by the sofa
grab the mug by its handle | pick | object mug
grab the pan by the handle with the left hand | pick | object pan, hand left
take the milk out of the fridge | pick | object milk, source fridge
take out the milk from the fridge | pick | object milk, source fridge
take the lid off the jar | pick | object lid, source jar
take off the lid | pick | object lid
pick up the toy in front of the sofa | pick | object toy in front of the sofa
take the pen in the cup | pick | object pen, source cup
remove the lid from the pot | pick | object lid, source pot
retrieve the ball from under the couch | pick | object ball, source couch
fetch the toy from behind the door | pick | object toy, source door
get the box from on top of the wardrobe | pick | object box, source wardrobe
lift the lid of the pot | pick | object lid of the pot
hold the flashlight in your left hand | pick | object flashlight, hand left
pick up the box with both hands | lift | object box
lift the crate using both arms | lift | object crate
carry the tray with two hands | lift | object tray
open the fridge | open | object fridge
open the refrigerator door | open | object refrigerator door
open the door of the cabinet under the sink | open | object cabinet under the sink
pull open the top drawer with your right hand | open | object top drawer, hand right
pull the drawer open | open | object drawer
close the microwave | close | object microwave
shut the cabinet door gently | close | object cabinet door
shut the lid slowly with the left hand | close | object lid, hand left
push the door closed | close | object door
slide the drawer shut | close | object drawer
push the drawer in | close | object drawer
push in the bottom drawer | close | object bottom drawer
slide the oven rack in with your left hand | close | object oven rack, hand left
turn on the light | press | state on, object light
turn the stove off | press | object stove, state off
switch off the TV | press | state off, object TV
turn on the lamp on the desk | press | state on, object lamp on the desk
turn off the tap with your left hand | press | state off, object tap, hand left
push the button | press | object button
push the switch with the left hand | press | object switch, hand left
push the elevator button | press | object elevator button
press the power button | press | object power button
press the off button | press | object off button
press the button on the microwave | press | object microwave
press the start button of the dryer | press | object dryer
press start on the dishwasher | press | object dishwasher
flip the switch | press | object switch
toggle the light switch on the wall | press | object light switch on the wall
push the box to the left | push | object box, direction left
push the chair under the table | push | object chair, target table
push the cart to the table | push | object cart, target table
slide the box across the table | push | object box, surface table
slide the plate along the counter with the right hand | push | object plate, surface counter, hand right
nudge the ball away | push | object ball, direction away
put the apple inside the fridge with the left hand | place_in | object apple, container fridge, hand left
place the apple in the bowl on the counter | place_in | object apple, container bowl on the counter
put the trash into the trash can next to the door | place_in | object trash, container trash can next to the door
throw away the can in the trash can | place_in | object can, container trash can
put the milk back in the fridge | place_in | object milk, container fridge
put the wrench in the drawer on the left | place_in | object wrench, container drawer on the left
put the mop and brush in the closet | place_in | object mop and brush, container closet
move the toy car into the box | place_in | object toy car, container box
Place the Mug on the Table. | place_on | object Mug, surface Table
place the cup on the table in the kitchen | place_on | object cup, surface table in the kitchen
put the keys on the hook by the door | place_on | object keys, surface hook by the door
place the pillow on the left side of the bed | place_on | object pillow, surface bed
put the box on the top of the shelf | place_on | object box, surface shelf
stack the red block on top of the blue block | place_on | object red block, surface blue block
move the pot onto the stove | place_on | object pot, surface stove
put the book on the shelf next to the lamp | place_next_to | object book, surface shelf, target lamp
put the shoes by the door | place_next_to | object shoes, target door
place the fork left of the plate | place_next_to | object fork, target plate
place the fork to the left of the plate | place_next_to | object fork, target plate
put the cup on the right of the plate | place_next_to | object cup, target plate
put the left shoe next to the right shoe | place_next_to | object left shoe, target right shoe
set the vase in front of the mirror | place_next_to | object vase, target mirror
put the shoes under the bed in the bedroom | place_under | object shoes, target bed in the bedroom
put the box on the floor under the window | place_under | object box, surface floor, target window
pour the milk and water into the glass | pour | object milk and water, container glass
pour the water from the pitcher into the glass | pour | object water, source pitcher, container glass
empty the trash can into the dumpster | pour | source trash can, container dumpster
sprinkle the salt over the salad | pour | object salt, container salad
wipe the table with a sponge | wipe | target table, tool sponge
wipe the table with the sponge in your right hand | wipe | target table, tool sponge, hand right
wipe the crumbs off the counter | wipe | object crumbs, target counter
wipe the spill from the floor with a towel | wipe | object spill, target floor, tool towel
use the sponge to wipe the counter | wipe | tool sponge, target counter
spray the plant with the spray bottle in the left hand | spray | target plant, tool spray bottle, hand left
spray cleaner on the window | spray | tool cleaner, target window
water the plants with the watering can | spray | target plants, tool watering can
hand the cup to the other hand | hand_over | object cup
give the cup to the right hand | hand_over | object cup, to_hand right
transfer the knife from your left hand to your right hand | hand_over | object knife, hand left, to_hand right
"""

BEYOND_US = """
pick up; the can; dance; put the cup; put the cup down; put down the cup; throw the paper away; turn the page
hold the door open; push in the chair; push the chair in; return the book to the shelf; lean the broom against the wall
tie the coat to the hook; move the chair to the table; use the remote to turn on the TV; flush the toilet
turn the knob; tip over the bucket; turn the pan over; empty the bottle; pour out the water; turn the cup upside down
push the box off the table; move the box off the table; put the cup on its side; put the cup on the left
put the spoon between the fork and the plate; peel the apple with the knife; fill the kettle with water
place the cup upside down on the table
release the cup; reach for the cup; rinse the plate under the tap; stir the soup with the spoon; unlock the door
pick up the cup and put it in the sink; open the door, then close it; move the cup from the left hand to the table
"""


@pytest.mark.parametrize("line", NATURAL.strip().splitlines())
def test_natural_sentences_name_one_skill(line: str) -> None:
    """With exactly the words that belong in each slot."""
    sentence, skill, words = line.split(" | ")
    call = match(sentence, SKILLS)
    assert call is not None
    assert (call.skill.name, dict(call.arguments)) == (skill, dict(pair.split(" ", 1) for pair in words.split(", ")))


@pytest.mark.parametrize("sentence", [s.strip() for s in BEYOND_US.replace("\n", ";").split(";") if s.strip()])
def test_what_no_skill_can_do_names_none(sentence: str) -> None:
    """Nothing is done rather than something else; several clauses are no single skill, either."""
    assert match(sentence, SKILLS) is None


@pytest.mark.parametrize(
    ("prompt", "wanted"),
    [
        ("pick up the cup and put it in the sink", "pick up the cup; put the cup in the sink"),
        ("Pick up the cup. Put it on the table.", "Pick up the cup; Put the cup on the table"),
        ("open the fridge, take the milk out of it", "open the fridge; take the milk out of the fridge"),
        ("pick up two cans and put them in the bin", "pick up two cans; put the two cans in the bin"),
        (
            "pick up the milk, open the fridge, and put it in the fridge",
            "pick up the milk; open the fridge; put the milk in the fridge",
        ),
        ("turn on the light and turn off the TV", "turn on the light; turn off the TV"),
        ("take the sponge, then wipe the table and dust the shelf", "take the sponge; wipe the table; dust the shelf"),
        ("pick up the cup and carefully put it down", "pick up the cup; put the cup down"),
        ("pick up the salt and pepper", "pick up the salt and pepper"),
        ("pick up the red, clean cup", "pick up the red, clean cup"),
        ("put the mop and brush in the closet", "put the mop and brush in the closet"),
        ("pour the milk and water into the glass", "pour the milk and water into the glass"),
        ("put it in the sink", "put it in the sink"),
        ("pick up $it", "pick up $it"),
    ],
)
def test_a_prompt_is_cut_where_a_verb_begins_another_clause(prompt: str, wanted: str) -> None:
    """Joined things stay whole, and "it" becomes the thing that was last done something to."""
    assert "; ".join(clauses(prompt, SKILLS)) == wanted
    assert clauses("; ".join(clauses(prompt, SKILLS)), SKILLS) == clauses(prompt, SKILLS), (
        "cutting again changes nothing"
    )

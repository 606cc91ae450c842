"""The tasks as ManiSkill's environment `MpviHouse-v1`, which importing this registers."""

from mpvi_bt.house.maniskill.env import MpviHouseEnv

__all__ = ["MpviHouseEnv"]

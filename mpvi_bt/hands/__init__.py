"""The shipped robots and the policies that move their hands. They stand in for a VLA."""

"""The robots that ship."""

"""Carrying out a policy's actions: rates, chunks, and a second policy behind the first."""

"""Frozen readings and reports: what the tool said of known files when they were last looked at.

    python -m tests.golden             refresh both files, and say in words what changed
    python -m tests.golden --check     only say it
"""

"""Measurements that are too long for the test-suite; each states its command and its cost."""

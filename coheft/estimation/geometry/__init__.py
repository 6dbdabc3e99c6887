"""Frames, poses and motions of rigid bodies. Imports numpy only."""

"""The fence: no motion is commanded that would take the body beyond it."""

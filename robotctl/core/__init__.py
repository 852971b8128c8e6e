"""The pure step of the control process, put together."""

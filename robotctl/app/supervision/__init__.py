"""Starting, watching, restarting and ending the processes."""

"""Access from other machines: certificates, passwords and rights."""

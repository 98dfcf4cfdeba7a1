"""Who may connect from other machines: certificates, passwords and rights."""

"""What every storey may use: errors, ports, contacts, imperfect joints."""

"""What commands share: arguments, exit status, messages and start-up."""

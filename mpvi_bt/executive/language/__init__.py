"""Language models: chat, exchanges on file, budgets."""

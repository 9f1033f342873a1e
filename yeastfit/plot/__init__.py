"""Pictures: functions take results and return figures."""

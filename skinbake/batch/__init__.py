"""From a batch file to a folder a look: who bakes which, on this machine's processes or a cluster's."""

"""Constants of flesh from markers that people wore on their skin: `dsnet train --markers`."""

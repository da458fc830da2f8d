"""Whether the best pose is an answer: rivals, symmetries, open directions, bias."""

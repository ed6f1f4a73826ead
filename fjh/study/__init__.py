"""Infrastructure of studies, independent of robots: options, results, files, figures, workers."""

/* What a test of a law's library uses of a C library: printf of %s, %d and %.9g. */
#ifndef STDIO_H
#define STDIO_H
#ifdef __cplusplus
extern "C"
#endif
int printf(const char *format, ...);
#endif

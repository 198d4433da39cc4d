#ifndef STRING_H
#define STRING_H
#ifdef __cplusplus
extern "C"
#endif
void *memcpy(void *to, const void *from, __SIZE_TYPE__ n);
#endif
